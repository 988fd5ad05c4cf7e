"""Bad input at every command: one sentence that says what is wrong, exit code 2, and nothing lost."""

from __future__ import annotations

import json
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from device_agent.cli import main
from navcore.recording import RecordingWriter
from navcore.site import Site, save_site
from navcore.site_files import SCHEMA_VERSION
from navcore.types import CameraIntrinsics, Frame

CAMERA = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
Refusal = Callable[..., str]


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Refusal:
    """Run ``vbr``, see that it refuses, and return its sentence."""

    def run(*arguments: object) -> str:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as ended:
            code = int(ended.code or 0)
        out, err = capsys.readouterr()
        sentence = err.strip().splitlines()[-1]
        assert code == 2
        assert out == ""
        assert sentence.startswith("vbr")
        assert "Traceback" not in err
        return sentence

    return run


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    writer = RecordingWriter(tmp_path / "walk", CAMERA)
    rng = np.random.default_rng(1)
    for index in range(3):
        colour = rng.integers(0, 256, (48, 64, 3)).astype(np.uint8)
        writer.add(Frame(1.0 + 0.1 * index, colour, np.full((48, 64), 2.0, np.float32)))
    writer.close()
    return tmp_path / "walk"


@pytest.fixture
def site(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "site")
    return tmp_path / "site"


def cut(name: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        file = folder / name
        file.write_bytes(file.read_bytes()[: file.stat().st_size * 3 // 4])

    return change


def replaced(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def written(name: str, data: bytes) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).write_bytes(data)

    return change


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (shutil.rmtree, "There is no recording at"),
        (cut("rgb/1.000000.jpg"), "missing or damaged"),
        (cut("calib.txt"), "calib.txt"),
        (replaced("calib.txt", "fx 60.0", "fx 0"), "greater than 0"),
        (replaced("calib.txt", "fx 60.0", "fx nan"), "line 1"),
        (replaced("calib.txt", "fx 60.0", "fx 1e-300"), "focal lengths"),
        (replaced("calib.txt", "fx 60.0", "fx 1e300"), "focal lengths"),
        (replaced("calib.txt", "fx 60.0\n", ""), "has no fx"),
        (replaced("calib.txt", "cx 31.5", "cx 63.5"), "far from the middle"),  # of the camera at twice the size
        (replaced("calib.txt", "cx 31.5", "cx 15.5"), "far from the middle"),  # at half the size
        (replaced("calib.txt", "depth_factor 1000.0", "depth_factor 1e-300"), "depth_factor"),
        (replaced("calib.txt", "fx", "k1 1e200\nfx"), "no lens"),
        (written("calib.txt", b"\xff\xfe\x00"), "calib.txt cannot be read"),
        (written("associations.txt", b""), "lists no frames"),
        (written("associations.txt", b"\xff\xfe\x00"), "associations.txt cannot be read"),
        (replaced("associations.txt", "1.100000 rgb", "nan rgb"), "line 2"),
        (replaced("associations.txt", "1.100000 depth", "nan depth"), "line 2"),
        (replaced("associations.txt", "rgb/1.100000", "rgb/\0"), "line 2"),
        (replaced("associations.txt", "1.100000 rgb", "garbage\n1.100000 rgb"), "line 2"),
        (written("groundtruth.txt", b"garbage\n"), "groundtruth.txt, line 1"),
        (lambda folder: None, "only 3 frames"),
    ],
)
def test_a_map_of_a_bad_recording_is_refused(
    refusal: Refusal, recording: Path, tmp_path: Path, change: Callable[[Path], None], sentence: str
) -> None:
    change(recording)
    assert sentence in refusal("map", "build", recording, "--site", tmp_path / "new")
    assert not (tmp_path / "new").exists()
    assert not [entry for entry in tmp_path.iterdir() if entry.name.startswith(".")]


@pytest.mark.parametrize("name", ["rgb/1.100000.jpg", "depth/1.100000.png"])
def test_an_image_that_ends_too_early_is_refused_wherever_it_stands(
    refusal: Refusal, recording: Path, tmp_path: Path, name: str
) -> None:
    lines = (recording / "associations.txt").read_text().splitlines()
    for number in range(10):
        lines.append(lines[1].replace("1.100000 rgb/1", f"{2 + number} rgb/1"))
    (recording / "associations.txt").write_text("\n".join(lines) + "\n")
    cut(name)(recording)
    assert f"{name} is missing" in refusal("map", "build", recording, "--site", tmp_path / "new")


def test_a_site_is_written_only_where_it_can_be(refusal: Refusal, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("dear")
    assert "holds other files" in refusal("map", "build", recording, "--site", tmp_path / "file")
    assert "holds other files" in refusal("map", "build", recording, "--site", recording)
    assert "No site can be written" in refusal("map", "build", recording, "--site", tmp_path / "file" / "below")
    assert (tmp_path / "file").read_text() == "dear"


def test_recording_and_site_are_not_taken_for_each_other(refusal: Refusal, recording: Path, site: Path) -> None:
    assert "associations.txt cannot be read" in refusal("map", "build", site, "--site", site)
    assert "associations.txt cannot be read" in refusal("localize", "--site", site, site)
    assert "There is no site at" in refusal("localize", "--site", recording, recording)
    assert "There is no site at" in refusal("console", "--site", recording, "--port", 0)


@pytest.mark.parametrize(
    "name",
    ["manifest.json", "camera.json", "map/descriptors.npy", "road/000.npy", "cloud/points_m.npy", "poi_graph.json"],
)
def test_a_damaged_site_is_refused_by_every_command(
    refusal: Refusal, recording: Path, site: Path, tmp_path: Path, name: str
) -> None:
    cut(name)(site)
    for command in (
        ("localize", "--site", site, recording),
        ("console", "--site", site, "--port", 0),
        ("device", "--site", site, "--simulated", "--to", "Bar", "--state", tmp_path / "state"),
    ):
        sentence = refusal(*command)
        assert name in sentence
        assert "damaged" in sentence


def test_a_newer_site_and_a_map_of_another_form_are_refused(refusal: Refusal, recording: Path, site: Path) -> None:
    assert "The map is damaged" in refusal("localize", "--site", site, recording)
    replaced("manifest.json", f'"schema_version": {SCHEMA_VERSION}', f'"schema_version": {SCHEMA_VERSION + 1}')(site)
    assert "newer program" in refusal("localize", "--site", site, recording)


def test_an_edge_to_nowhere_is_damage(refusal: Refusal, recording: Path, site: Path) -> None:
    graph = json.loads((site / "poi_graph.json").read_text())
    graph["edges"]["a-b"]["b"] = "gone"
    (site / "poi_graph.json").write_text(json.dumps(graph))
    assert "edge a-b" in refusal("localize", "--site", site, recording)


def test_a_trajectory_goes_to_a_file(refusal: Refusal, recording: Path, site: Path, tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none" / "out.txt"):
        assert "cannot be written" in refusal("localize", "--site", site, recording, "--trajectory", path)


@pytest.mark.parametrize(
    "option",
    [
        ("--size", "0x0"), ("--size", "9999x9999"), ("--rate-hz", "0"), ("--rate-hz", "nan"), ("--rate-hz", "inf"),
        ("--seed", "-1"), ("--seed", "1e9"), ("--seed", "9" * 5000),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", ["demo", "device", "sim"])
def test_a_simulation_that_cannot_be_is_refused_before_it_begins(
    refusal: Refusal, tmp_path: Path, command: str, option: tuple[str, str]
) -> None:
    rest = {
        "demo": ["--headless", "--data", tmp_path / "data"],
        "device": ["--site", tmp_path, "--simulated"],
        "sim": ["record", tmp_path / "recording"],
    }
    assert f"argument {option[0]}" in refusal(command, *rest[command], *option)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--max-s", "nan"), "no number"),
        (("--max-s", "-1"), "greater than 0"),
        (("--from", "Nowhere"), "choose one of Hall, Wash room"),
        (("--set", "gate.clearance_m=99"), "gate.clearance_m cannot be 99"),
        (("--set", "gate.clearance_m=NaN"), "gate.clearance_m cannot be"),
        (("--set", "gate.clearance_m=true"), "gate.clearance_m cannot be"),
        (("--set", "cues.language=xx"), "choose one of en, zh"),
        (("--set", "obstacle.leave_frames_count=1.5"), "a whole number"),
        (("--set", "no.such=1"), "There is no setting"),
    ],
)
def test_a_demo_that_cannot_be_is_refused_before_the_building_is_mapped(
    refusal: Refusal, tmp_path: Path, options: tuple[str, str], sentence: str
) -> None:
    assert sentence in refusal("demo", "--headless", "--data", tmp_path / "data", *options)
    assert not (tmp_path / "data").exists()


def test_the_demo_needs_a_folder_that_can_be_made(refusal: Refusal, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "cannot be made" in refusal("demo", "--headless", "--data", tmp_path / "file" / "below")


@pytest.mark.parametrize(
    "address", ["http://x", "ws://", "ws://[::1", "ws://127.0.0.1:x", "ws://127.0.0.1:99999", "nonsense"]
)
def test_a_device_refuses_what_is_no_address(refusal: Refusal, tmp_path: Path, address: str) -> None:
    (tmp_path / "token").write_text("t" * 40)
    token = ("--token-file", tmp_path / "token")
    assert "no address" in refusal("device", "--site", tmp_path, "--simulated", "--console", address, *token)


def test_a_device_has_one_camera(refusal: Refusal, site: Path, tmp_path: Path) -> None:
    device = ("device", "--site", site, "--simulated")
    assert "only one of" in refusal(*device, "--recording", tmp_path)
    assert "--simulated, --recording DIR, or --camera NAME" in refusal("device", "--site", site)


@pytest.fixture
def taken_port() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield int(listening.getsockname()[1])


def test_a_console_that_cannot_serve_says_why(refusal: Refusal, site: Path, tmp_path: Path, taken_port: int) -> None:
    (tmp_path / "text").write_text("no key at all")
    (tmp_path / "spaces").write_text("no token " * 10)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "console.sqlite3").write_bytes(b"garbage!" * 500)
    console = ("console", "--site", site)
    assert f"Port {taken_port}" in refusal(*console, "--port", taken_port)
    assert "no port" in refusal(*console, "--port", "x")
    assert "no port" in refusal(*console, "--port", 99999)
    pem = ("--tls-cert", tmp_path / "text", "--tls-key", tmp_path / "text")
    assert "no certificate" in refusal(*console, "--port", 0, *pem)
    assert "in the clear" in refusal(*console, "--host", "0.0.0.0", "--port", 0)
    assert "ready file" in refusal(*console, "--port", 0, "--ready-file", tmp_path)
    assert "ready file" in refusal(*console, "--port", 0, "--ready-file", tmp_path / "none" / "ready.json")
    assert "no token" in refusal(*console, "--port", 0, "--device-token-file", tmp_path / "spaces")
    assert "cannot be made" in refusal(*console, "--port", 0, "--data", tmp_path / "text")
    assert "damaged" in refusal(*console, "--port", 0, "--data", tmp_path / "broken")


def test_a_mistyped_site_gets_no_tokens(refusal: Refusal, tmp_path: Path) -> None:
    for command in (("token", "glasses"), ("admin-link",)):
        assert "There is no site at" in refusal("console", "--site", tmp_path / "gone", *command)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [(), ("bogus",), ("map",), ("map", "burn"), ("settings", "--bogus")])
def test_a_command_that_is_none_is_refused(refusal: Refusal, arguments: tuple[str, ...]) -> None:
    assert "error" in refusal(*arguments)
