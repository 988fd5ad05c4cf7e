"""The command ``vbr``: exit codes, and one sentence for each refusal."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import pytest

from device_agent.cli import add_module, main
from navcore.errors import MissingPackageError, SiteError
from navcore.settings import setting_specs
from navcore.site import Site, save_site


def vbr(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    try:
        code = main(arguments)
    except SystemExit as ended:
        code = int(ended.code or 0)
    out, err = capsys.readouterr()
    return code, out, err


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = vbr(capsys, "--version")
    assert (code, out.split()[0]) == (0, "vbr")
    code, out, _ = vbr(capsys, "--help")
    assert code == 0
    for command in ("device", "settings", "warm-up", "sim"):
        assert command in out


def test_settings_are_listed_whole(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = vbr(capsys, "settings", "--json")
    assert (code, [entry["key"] for entry in json.loads(out)]) == (0, [spec.key for spec in setting_specs()])
    code, out, _ = vbr(capsys, "settings")
    assert code == 0
    assert all(spec.key in out for spec in setting_specs())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["device", "--site", "{gone}", "--simulated", "--to", "Bar"], "There is no site at"),
        (
            ["device", "--site", "{gone}", "--simulated", "--set", "gate.clearance_m=99"],
            "gate.clearance_m cannot be 99",
        ),
        (["device", "--site", "{gone}", "--simulated", "--set", "nonsense"], "not of the form group.name=value"),
        (["device", "--site", "{gone}", "--simulated", "--console", "http://x"], "ws:// or wss://"),
        (["device", "--site", "{gone}", "--simulated", "--console", "ws://console.example"], "use wss://"),
        (["device", "--site", "{gone}", "--simulated", "--console", "ws://127.0.0.1:9"], "--token-file"),
        (["device", "--site", "{gone}"], "--simulated"),
        (["device", "--site", "{gone}", "--simulated", "--device-id", "../x"], "letters, digits"),
        (["device", "--site", "{gone}", "--simulated", "--console", "ws://[::1]:9", "--token-file", "{full}"], "token"),
        (["sim", "record", "{full}"], "is not empty"),
    ],
)
def test_a_refusal_is_one_sentence_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    filled = [text.format(gone=tmp_path / "gone", full=tmp_path / "full") for text in arguments]
    code, _, err = vbr(capsys, *filled)
    assert code == 2
    assert sentence in err
    assert err.startswith("vbr: ")
    assert len(err.strip().splitlines()) == 1


def test_a_place_that_is_not_there_is_refused_with_those_that_are(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, small_site: Site
) -> None:
    save_site(small_site, tmp_path / "site")
    code, _, err = vbr(capsys, "device", "--site", str(tmp_path / "site"), "--simulated", "--to", "Barr")
    assert (code, err) == (2, "vbr: There is no place 'Barr' in this site: choose Bar.\n")


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    with pytest.raises(SiteError):
        main(["--debug", "device", "--site", str(tmp_path / "gone"), "--simulated"])


def test_a_wrong_command_line_is_refused_with_the_usage(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = vbr(capsys, "sim", "record", "x", "--size", "big")
    assert code == 2
    assert "write 320x240" in err


def test_a_module_that_lacks_its_package_leaves_a_command_that_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "needs_fastapi.py").write_text("import fastapi\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sys.modules, "fastapi", None)
    parser = argparse.ArgumentParser()
    add_module(parser.add_subparsers(), "console", "needs_fastapi")
    arguments = parser.parse_args(["console", "--site", "anything", "else"])
    with pytest.raises(MissingPackageError, match=r"virtual-blind-road\[console\]"):
        arguments.run(arguments)


def test_an_interrupt_ends_the_command_quietly(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("device_agent.maintenance_commands._list_settings", interrupted)
    assert vbr(capsys, "settings") == (130, "", "")
