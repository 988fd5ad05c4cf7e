"""Shared fixtures: real parts, made small."""

from __future__ import annotations

import fcntl
import functools
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest

from benchmarks.kills.sites import small_site as made_small_site
from device_agent.cli import main
from device_agent.simulation.building import Building, renderer_of
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walk_recording import record_walk
from navcore.site import Site, save_site

if TYPE_CHECKING:
    from console_room import Person
    from link_processes import ConsoleProcess
    from link_proxy import Network
    from xdist.remote import Producer
    from xdist.scheduler import LoadScopeScheduling

    from console.server import ConsoleServer

# The same examples in every run: what is found by chance is found once, and becomes a test of its own.
# How long one takes is no test's business: a busy machine may hold any of them up.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """Keep together what shares something dear: a file's tests; those with a Chromium, of which one draws at a time.

    Not by xdist_group: pytest-xdist 3.8 does not hear of it under pytest 9.2.
    """
    from xdist.scheduler import LoadScopeScheduling

    class TogetherScheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::", 1)[0]
            return "browser" if _drives_browser(config.rootpath / file) else file

    return TogetherScheduling(config, log)


@functools.cache
def _drives_browser(file: Path) -> bool:
    return "pytest.mark.browser" in file.read_text(encoding="utf-8")


def data_folder() -> Path:
    """Where the real recordings lie: VBR_DATA, or ../shared/data beside the checkout."""
    return Path(os.environ.get("VBR_DATA", REPOSITORY.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def fr1_rpy() -> Path:
    return _recording("fr1_rpy_350")


@pytest.fixture(scope="session")
def fr3_cabinet() -> Path:
    return _recording("fr3_cabinet_58")


def _recording(name: str) -> Path:
    folder = data_folder() / name
    if not folder.is_dir():
        pytest.skip(f"the real recording {name} is not at {data_folder()} (set VBR_DATA)")
    return folder


@pytest.fixture
def small_site() -> Site:
    """A site of a few points: its form is real, its map is not usable for localization."""
    return made_small_site()


@pytest.fixture(scope="session")
def office() -> Building:
    """The simulated office floor."""
    return office_floor()


@pytest.fixture(scope="session")
def office_renderer(office: Building) -> Renderer:
    """Renders the office floor; painting its pictures takes seconds, so all tests share one."""
    return renderer_of(office)


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return the folder that ``make`` fills once in a run, for whichever of the test processes needs it first.

    The others wait for it. Nobody may write into it: who wants to change something copies it.
    """
    base = factory.getbasetemp()
    # Each of pytest-xdist's processes has a folder of its own in the run's.
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, unfinished = shared / name, shared / f"{name}-unfinished"
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(folder)
    return folder


@pytest.fixture(scope="session")
def office_recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sighted person's walk from the hall to the wash room, recorded: camera, noise and gait as in the demo."""

    def record(folder: Path) -> None:
        office, renderer = (request.getfixturevalue(name) for name in ("office", "office_renderer"))
        record_walk(folder / "recording", seed=0, max_length_m=20.0, building=office, renderer=renderer)

    return made_once(tmp_path_factory, "office-recording", record) / "recording"


@pytest.fixture(scope="session")
def office_site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site that ``vbr map build`` makes of that recording."""

    def build(folder: Path) -> None:
        recording = str(request.getfixturevalue("office_recording"))
        assert main(["map", "build", recording, "--site", str(folder / "site"), "--name", "Office floor"]) == 0

    return made_once(tmp_path_factory, "office-site", build) / "site"


# What tests of the console share; imported where it is used, for most tests need no server.
@pytest.fixture
def server(tmp_path: Path, small_site: Site) -> Iterator[ConsoleServer]:
    """A real console of the small site, in this process."""
    from console_room import serving

    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as running:
        yield running


@pytest.fixture
def admin(server: ConsoleServer) -> Person:
    """Whoever set the console up, signed in."""
    from console_room import first_admin

    return first_admin(server)


@pytest.fixture
def console(tmp_path: Path, small_site: Site) -> Iterator[ConsoleProcess]:
    """A real console of the small site, as a process that can be killed."""
    from link_processes import ConsoleProcess

    save_site(small_site, tmp_path / "site")
    process = ConsoleProcess(tmp_path / "site", tmp_path)
    yield process
    process.kill()


@pytest.fixture
def network(console: ConsoleProcess) -> Iterator[Network]:
    """The way to that console, which can be cut or made narrow."""
    from link_proxy import Network

    way = Network(console.port)
    yield way
    way.close()
