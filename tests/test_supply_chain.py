"""Others' work in ours: locked by hash, under licences that permit it, with a reason, and listed as it is.

The programs of ``.ci/`` themselves, over the real lock files and over damaged copies; nothing is fetched.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / ".ci"))

import client_packages  # noqa: E402
import dependency_page  # noqa: E402
import licence_rules  # noqa: E402
import locked  # noqa: E402

ELSEWHERE = re.compile(r"copyright|@licen[cs]e|/\*!|sourceMappingURL|\beval\(", re.IGNORECASE)
ADDRESS = re.compile(r"(?:https?:)?//[a-z0-9-]+(?:\.[a-z0-9-]+)+", re.IGNORECASE)
OUR_ADDRESSES = {"http://www.w3.org"}
"""The namespace of SVG: a name, never opened."""
LONGEST_LINE = 1000
"""Longer lines are what minifiers write."""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for name in (*locked.LOCKS, "pyproject.toml", "Makefile", "README.md"):
        shutil.copy(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / "docs", tmp_path / "docs", ignore=shutil.ignore_patterns("*.jpg"))
    return tmp_path


# ------------------------------------------------------------------------------------------------ the lock files
def test_every_pin_has_hashes_and_a_lock_that_has_not_is_refused(copy: Path) -> None:
    pins = locked.all_pins()
    assert {algorithm for pin in pins for algorithm, _ in pin.hashes} == {"sha256"}
    assert all(len(digest) == 64 for pin in pins for _, digest in pin.hashes)
    lock = copy / "requirements.lock"
    whole = lock.read_text(encoding="utf-8")
    for damaged in (
        re.sub(r"(h11==\S+ \\\n)(    --hash=.*\n)+", r"\1", whole),
        whole + "h12==1.0\n", whole + "h12>=1.0 --hash=sha256:00\n", whole + "git+ssh://somewhere/h12\n",
    ):  # fmt: skip
        assert damaged != whole
        lock.write_text(damaged, encoding="utf-8")
        with pytest.raises(locked.LockError, match="run make lock"):
            locked.all_pins(copy)


def test_the_lock_of_the_glasses_is_whole_and_no_more() -> None:
    run = [sys.executable, str(ROOT / ".ci" / "locked.py")]
    text = subprocess.run([*run, "serial"], capture_output=True, text=True, check=True).stdout
    names = {line.partition("==")[0] for line in text.splitlines() if "==" in line and not line.startswith(" ")}
    direct = {locked.requirement_name(each) for extra in ("", "serial") for each in locked.project()[extra]}
    needs = locked.children(locked.all_pins())
    assert direct <= names
    assert all(needs[name] <= names for name in names), "with --require-hashes, pip looks for nothing else"
    assert not names & {"viser", "fastapi", "pytest", "hypothesis", "open3d"}
    every_line = {line.strip() for lock in locked.LOCKS for line in (ROOT / lock).read_text().splitlines()}
    assert {line.strip().removesuffix(" \\") for line in text.splitlines()} <= {
        line.removesuffix(" \\") for line in every_line
    }
    unknown = subprocess.run([*run, "wings"], capture_output=True, text=True, check=False)
    assert unknown.returncode == 1
    assert "no extra 'wings'" in unknown.stderr


# -------------------------------------------------------------------------------------------------- licences
def test_all_licences_are_permitted_or_judged() -> None:
    run = subprocess.run(
        [sys.executable, ROOT / ".ci" / "licences", "--check"], capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "within"),
    [
        ("MIT", True), ("GPL-3.0-only", False), ("AGPL-3.0-or-later", False), ("LGPL-2.1-or-later", False),
        ("MIT OR GPL-2.0-only", True), ("MIT AND GPL-2.0-only", False), ("(MIT OR GPL-2.0-only) AND MPL-2.0", False),
        ("GPL-3.0-or-later WITH GCC-exception-3.1", True), ("GPL-3.0-or-later", False),
        ("Apache-2.0 WITH LLVM-exception", True), ("LicenseRef-Proprietary", False), ("whatever you like", False),
    ],
)  # fmt: skip
def test_an_expression_permits_what_all_its_parts_do(words: str, within: bool) -> None:
    permitted = licence_rules.Table.read().permitted
    assert licence_rules.is_within(licence_rules.spdx(words), permitted) is within


def test_what_nobody_has_judged_is_complained_of() -> None:
    table, pins = licence_rules.Table.read(), locked.all_pins()

    def named(changed: licence_rules.Table) -> set[str]:
        return {sentence.split(" ")[0] for sentence in licence_rules.complaints(pins, changed)}

    assert named(table) == set()
    assert named(replace(table, judged={})) == {"certifi", "fqdn", "tqdm"}
    assert named(replace(table, development=frozenset())) == {"axe-playwright-python", "hypothesis", "pathspec"}
    assert named(replace(table, stated=table.stated | {"numpy": "MIT", "gone": "MIT"})) == {"numpy", "gone"}
    assert "scipy" in named(replace(table, stated={}))
    assert "opencv-python-headless" in named(replace(table, bundled_judged={}))
    assert "numpy" in named(replace(table, bundled={}))


def test_a_library_is_found_wherever_in_a_wheel_it_lies() -> None:
    assert "libllvmlite" in licence_rules.bundled_libraries("llvmlite"), "within the package"
    assert {"libOpen3D", "libtbb"} <= licence_rules.bundled_libraries("open3d"), "with a version behind its name"
    assert "libscipy_openblas64_" in licence_rules.bundled_libraries("numpy"), "in a folder beside the package"
    table, pins = licence_rules.Table.read(), locked.all_pins()
    unnamed = {name: licence for name, licence in table.bundled.items() if name != "libtbb"}
    assert list(licence_rules.complaints(pins, replace(table, bundled=unnamed))) == [
        "open3d carries libtbb with it: find out its licence, and name it in [bundled]."
    ]


def test_what_is_in_the_client_of_viser_is_known_and_what_nobody_has_judged_is_complained_of(tmp_path: Path) -> None:
    table, parts = licence_rules.Table.read(), client_packages.client_packages()
    assert {"react", "three", "@mantine/core"} <= {part.name for part in parts}
    assert not {"eslint", "vitest", "fsevents"} & {part.name for part in parts}, "it is not made of those"
    assert list(licence_rules.client_complaints(parts, table)) == []
    strange = client_packages.ClientPackage("leftpad", "1", "AGPL-3.0-only", "00")
    silent = client_packages.ClientPackage("rightpad", "1", "", "00")
    without = replace(table, client_judged={"gone": "?"}, client_stated={"react": "MIT"})
    found = list(licence_rules.client_complaints([*parts, strange, silent], without))
    assert {sentence.split(" ")[0].rstrip(",") for sentence in found} == {
        "leftpad", "rightpad", "webgl-constants", "argparse", "caniuse-lite", "lightningcss", "gone", "react",
    }  # fmt: skip
    lock = tmp_path / "package-lock.json"
    for damaged in ("", "{}", "[]", '{"packages": {"node_modules/a": {"version": "1", "integrity": "md5-00"}}}'):
        lock.write_text(damaged, encoding="utf-8")
        with pytest.raises(locked.LockError, match="cannot be read"):
            client_packages.client_packages(lock)


# --------------------------------------------------------------------------------------- why each dependency is there
def test_a_dependency_without_a_line_and_a_line_without_a_dependency_are_complained_of(copy: Path) -> None:
    table = licence_rules.Table.read()
    assert list(dependency_page.complaints(table, copy)) == []
    project = copy / "pyproject.toml"
    text = project.read_text(encoding="utf-8")
    project.write_text(text.replace('    "mcap>=1.6",\n', '    "leftpad>=1",\n'), encoding="utf-8")
    found = list(dependency_page.complaints(table, copy))
    assert any("no line for leftpad" in each for each in found)
    assert any("a line too many for mcap." in each for each in found)
    page = copy / dependency_page.PAGE
    project.write_text(text, encoding="utf-8")
    page.write_text(page.read_text(encoding="utf-8").replace("| MPL-2.0 | both |", "| MIT | both |"), encoding="utf-8")
    assert list(dependency_page.complaints(table, copy)) == [f"{dependency_page.PAGE}: hypothesis is under MPL-2.0."]


@pytest.mark.parametrize(
    "command", ["pip install viser", "\t@$(BIN)/python -m pip install --quiet uv", "sudo pip install -U x"]
)
def test_what_would_install_without_hashes_is_complained_of(copy: Path, command: str) -> None:
    assert list(dependency_page.careless_installs(copy)) == []
    with (copy / "docs" / "device.md").open("a", encoding="utf-8") as page:
        page.write(f"{command}\n")
    assert "without hashes" in "".join(dependency_page.careless_installs(copy))


# ---------------------------------------------------------------------------------------- the bill of materials
def made_here(extras: list[str]) -> str:
    """Make a bill of materials in this process."""
    loader = SourceFileLoader("sbom", str(ROOT / ".ci" / "sbom"))
    spec = spec_from_loader("sbom", loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return str(module.bill(extras))


def test_the_bill_of_materials_is_valid_whole_and_the_same_each_time(tmp_path: Path) -> None:
    out = tmp_path / "glasses.json"
    subprocess.run([sys.executable, ROOT / ".ci" / "sbom", out], capture_output=True, check=True)
    text = out.read_text(encoding="utf-8")
    assert text == made_here([""]), "in another process"
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    bill = json.loads(text)
    pins = {pin.name: pin for pin in locked.all_pins()}
    base = locked.needed_by([""], pins.values())
    parts = {part["name"]: part for part in bill["components"]}
    assert parts.keys() == base
    assert not parts.keys() & {"viser", "pytest"}
    for name, part in parts.items():
        assert part["purl"].startswith(f"pkg:pypi/{name}@")
        assert part["licenses"][0]["expression"]
        assert part["externalReferences"][0]["hashes"]
    needs = {each["ref"]: set(each.get("dependsOn", ())) for each in bill["dependencies"]}
    direct = {locked.requirement_name(each) for each in locked.project()[""]}
    assert {ref.partition("==")[0] for ref in needs["virtual-blind-road"]} == direct
    httpx = next(ref for ref in needs if ref.startswith("httpx=="))
    assert {ref.partition("==")[0] for ref in needs[httpx]} == {"anyio", "certifi", "httpcore", "idna"}
    assert "timestamp" not in text


def test_the_bill_of_the_console_names_what_viser_carries_in_its_page() -> None:
    bill = json.loads(made_here(["", "console"]))
    parts = {part["bom-ref"]: part for part in bill["components"]}
    core = next(part for ref, part in parts.items() if ref.startswith("pkg:npm/%40mantine/core@"))
    assert (core["group"], core["name"], core["licenses"][0]["expression"]) == ("@mantine", "core", "MIT")
    assert len(core["externalReferences"][0]["hashes"][0]["content"]) == 128
    needs = {each["ref"]: set(each.get("dependsOn", ())) for each in bill["dependencies"]}
    viser = next(ref for ref in parts if ref.startswith("viser=="))
    assert {ref for ref in parts if ref.startswith("pkg:npm/")} < needs[viser]
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(json.dumps(bill)) is None


def test_the_bill_of_the_glasses_is_of_what_is_put_on_them() -> None:
    said = subprocess.run(
        ["make", "--dry-run", "sbom", "glasses", "EXTRAS=serial"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert re.search(r"sbom/glasses\.json serial$", said, re.MULTILINE)
    assert re.search(r"\.ci/glasses \S+ serial$", said, re.MULTILINE)


# ------------------------------------------------------------------------------------------ nobody's code copied in
@pytest.mark.parametrize("name", ["sbom", "licences", "fuzz"])
def test_a_tool_that_is_asked_what_it_does_says_so_and_does_nothing(name: str, tmp_path: Path) -> None:
    command = [ROOT / ".ci" / name, "--help"] if name == "fuzz" else [sys.executable, ROOT / ".ci" / name, "--help"]
    told = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert f".ci/{name}" in told.stdout
    assert "distributions" not in told.stdout
    assert list(tmp_path.iterdir()) == []


def test_the_list_of_licences_has_headings_and_an_end_and_may_be_cut_short() -> None:
    command = [sys.executable, ROOT / ".ci" / "licences"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert lines[0].split() == ["DISTRIBUTION", "VERSION", "USE", "LICENCE"]
    assert lines[-1].endswith("distributions: nothing is wrong.")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as cut:
        assert cut.stdout is not None
        assert cut.stderr is not None
        cut.stdout.close()
        assert cut.stderr.read() == ""


def test_the_pages_hold_nobody_elses_code_and_fetch_nothing_from_elsewhere() -> None:
    for file in sorted((ROOT / "static").iterdir()):
        text = file.read_text(encoding="utf-8")
        assert ELSEWHERE.search(text) is None, file.name
        assert set(ADDRESS.findall(text)) <= OUR_ADDRESSES, file.name
        assert max(map(len, text.splitlines())) < LONGEST_LINE, f"{file.name} looks minified"
