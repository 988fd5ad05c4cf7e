"""The device as a service: systemd hears of the real loop's life, and of nothing else."""

from __future__ import annotations

import configparser
import os
import re
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from device_hall import Rig
from hardware_stand_ins import eventually

from device_agent.adapters.fakes import FakeLocalizer
from device_agent.agent import DeviceAgent
from device_agent.service.notify import BEATS_PER_TIMEOUT, ServiceNotifier
from navcore.types import Action

GROWING_PAUSES_SINCE = 254
UNIT = Path(__file__).resolve().parent.parent / "device_agent" / "service" / "vbr-device.service"


class Systemd:
    """The socket on which systemd listens."""

    def __init__(self, path: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(path)
        self._socket.setblocking(False)
        self.heard: list[str] = []

    def said(self) -> list[str]:
        while True:
            try:
                self.heard.append(self._socket.recv(4096).decode())
            except BlockingIOError:
                return self.heard

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[tuple[Systemd, dict[str, str]]]:
    listener = Systemd(str(tmp_path / "notify"))
    yield listener, {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "4000000"}
    listener.close()


def agent_with(rig: Rig, notifier: ServiceNotifier) -> DeviceAgent:
    parts = replace(rig.agent._parts, alive=notifier.alive)
    return DeviceAgent(parts, rig.agent.state, FakeLocalizer(rig.locate))


def test_the_loop_says_ready_once_and_then_that_it_lives(systemd: tuple[Systemd, dict[str, str]]) -> None:
    listener, environment = systemd
    rig = Rig()
    notifier = ServiceNotifier(environment, rig.clock.now_s)
    agent = agent_with(rig, notifier)
    assert listener.said() == []
    begin_s = rig.clock.now_s()
    for _ in range(100):
        rig.sonar.echo(None)
        agent.run_cycle()
    said = listener.said()
    assert said[0].startswith("READY=1\n")
    assert said[1:] == ["WATCHDOG=1"] * len(said[1:])
    expected = (rig.clock.now_s() - begin_s) / (4.0 / BEATS_PER_TIMEOUT)
    assert abs(len(said) - expected) <= 2


def test_a_loop_that_only_fails_says_nothing_so_that_it_is_started_anew(
    systemd: tuple[Systemd, dict[str, str]],
) -> None:
    listener, environment = systemd
    rig = Rig()
    agent = agent_with(rig, ServiceNotifier(environment, rig.clock.now_s))
    agent.run_cycle()
    assert len(listener.said()) == 1
    rig.locate_error = RuntimeError("broken")
    for _ in range(100):
        agent.run_cycle()
    assert len(listener.said()) == 1
    rig.locate_error = None
    agent.run_cycle()
    assert listener.said()[-1] == "WATCHDOG=1"


def test_a_camera_that_is_unplugged_is_no_reason_to_start_anew(systemd: tuple[Systemd, dict[str, str]]) -> None:
    from navcore.errors import SensorError

    listener, environment = systemd
    rig = Rig()
    agent = agent_with(rig, ServiceNotifier(environment, rig.clock.now_s))
    rig.spoil = lambda frame: SensorError("unplugged")
    for _ in range(30):
        rig.clock.sleep_until(rig.clock.now_s() + 0.2)
        agent.run_cycle()
    assert listener.said().count("WATCHDOG=1") >= 4


def test_a_live_loop_in_its_own_thread_is_heard_and_its_end_as_well(
    systemd: tuple[Systemd, dict[str, str]],
) -> None:
    listener, environment = systemd
    rig = Rig()
    notifier = ServiceNotifier(environment, rig.clock.now_s)
    agent, stopped = agent_with(rig, notifier), threading.Event()
    thread = threading.Thread(target=agent.run, args=(stopped,))
    thread.start()
    eventually(lambda: "WATCHDOG=1" in listener.said())
    stopped.set()
    thread.join(60.0)
    # The socket's queue is short, and nothing waits for room in it.
    listener.said()
    notifier.stopping()
    notifier.alive()
    assert listener.said()[-1] == "STOPPING=1"


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"NOTIFY_SOCKET": "/nowhere/socket", "WATCHDOG_USEC": "1000"},
        {"NOTIFY_SOCKET": "@no-such-name", "WATCHDOG_USEC": "nonsense"},
        {"NOTIFY_SOCKET": "x" * 500},
    ],
)
def test_where_nobody_listens_nothing_happens(environment: dict[str, str]) -> None:
    rig = Rig()
    agent = agent_with(rig, ServiceNotifier(environment))
    assert agent.run_cycle().guidance.action is Action.STOP
    assert agent.run_cycle().fault == ""


def test_another_process_is_not_asked_for_signs_of_life(systemd: tuple[Systemd, dict[str, str]]) -> None:
    listener, environment = systemd
    notifier = ServiceNotifier({**environment, "WATCHDOG_PID": str(os.getpid() + 1)}, iter(range(1000)).__next__)
    for _ in range(50):
        notifier.alive()
    assert len(listener.said()) == 1


def test_an_abstract_socket_is_found() -> None:
    name = f"vbr-test-{os.getpid()}"
    listener = Systemd("\0" + name)
    ServiceNotifier({"NOTIFY_SOCKET": "@" + name}).alive()
    assert listener.said()[0].startswith("READY=1")
    listener.close()


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(UNIT, encoding="utf-8")
    return parser


def test_the_unit_restarts_on_failure_watches_the_loop_and_is_not_root() -> None:
    service = unit()["Service"]
    assert (service["Type"], service["Restart"], service["User"]) == ("notify", "on-failure", "vbr")
    assert int(service["WatchdogSec"]) >= 10
    assert int(service["RestartMaxDelaySec"]) > int(service["RestartSec"])
    assert service["NoNewPrivileges"] == service["ProtectHome"] == "yes"
    assert unit()["Unit"]["StartLimitIntervalSec"] == "0"
    assert "Requires" not in unit()["Unit"]
    assert "Wants" not in unit()["Unit"]


def test_systemd_finds_no_fault_in_the_unit(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed (package systemd)")
    program = tmp_path / "vbr"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    copy = tmp_path / UNIT.name
    copy.write_text(UNIT.read_text(encoding="utf-8").replace("/opt/virtual-blind-road/bin/vbr", str(program)))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(copy)], capture_output=True, text=True, timeout=60, check=False
    )
    complaints = [line for line in done.stderr.splitlines() if UNIT.name in line]
    if _systemd_version() < GROWING_PAUSES_SINCE:
        # The unit is good all the same: what is not known is passed over, and RestartSec holds.
        unknown = [
            line for line in complaints if re.search(r"Unknown key '\w+' in section \[Service\], ignoring", line)
        ]
        assert sorted(re.findall(r"'(\w+)'", " ".join(unknown))) == ["RestartMaxDelaySec", "RestartSteps"]
        complaints = [line for line in complaints if line not in unknown]
    assert complaints == []
    assert done.returncode == 0, done.stderr
    assert int(unit()["Service"]["RestartSec"]) > 0, "how an older systemd pauses"


def _systemd_version() -> int:
    said = subprocess.run(["systemd-analyze", "--version"], capture_output=True, text=True, timeout=60, check=True)
    return int(said.stdout.split()[1])
