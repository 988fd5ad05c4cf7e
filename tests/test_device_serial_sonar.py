"""The rangefinder over a real pseudo-terminal: garbage, silence, flood, unplugged and plugged in again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hardware_stand_ins import SerialLine, eventually

pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")

from device_agent.adapters.clocks import FakeClock, SteppedClock, SystemClock
from device_agent.adapters.fakes import FakeCamera, FakeLocalizer, FakeOutput, FakeUplink
from device_agent.adapters.reopening import LONGEST_BACKOFF_S, Reopening
from device_agent.adapters.serial_sonar import HeardLine, SerialSonar, SerialSource, check_line, reading_of
from device_agent.adapters.sonar_line import SonarKind, SonarLine, encoded
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.ports import Clock, Sonar
from device_agent.state import DeviceState
from navcore.errors import SensorError
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality, SonarReading, SonarState


@pytest.fixture
def line(tmp_path: Path) -> Iterator[SerialLine]:
    line = SerialLine(tmp_path)
    yield line
    line.close()


def reopened(line: SerialLine, clock: Clock) -> Reopening[HeardLine]:
    return Reopening("The rangefinder", lambda: SerialSource(line.path, clock), check_line, clock)


def test_a_line_is_read_and_its_age_is_known(line: SerialLine) -> None:
    clock = SteppedClock(100.0)
    source = SerialSource(line.path, clock)
    line.say(5000, 1200)
    assert source.read().stamp_s == 100.0
    clock.sleep_until(101.0)
    # Sent 0.3 s after the first, and read 0.7 s later: it has waited in a buffer.
    line.say(5300, 1300)
    heard = source.read()
    assert (heard.stamp_s, heard.line.distance_mm) == (pytest.approx(100.3), 1300)
    source.close()
    source.close()


def test_of_what_has_waited_the_newest_counts(line: SerialLine) -> None:
    source = SerialSource(line.path, SteppedClock(100.0))
    lines = [encoded(SonarLine(1000 + 50 * index, SonarKind.ECHO, 2000 - index)) for index in range(20)]
    line.send(b"".join(lines))
    line.settle(sum(len(each) for each in lines))
    assert source.read().line.distance_mm == 1981


def test_a_good_line_amid_garbage_is_read(line: SerialLine) -> None:
    source = SerialSource(line.path, SteppedClock(100.0))
    line.send(bytes(range(256)) + b"$U1,1,E,5*0000\n" + b"\xff" * 500)
    line.say(1000, 900)
    assert source.read().line.distance_mm == 900


def test_garbage_alone_is_an_error_that_says_so(line: SerialLine) -> None:
    source = SerialSource(line.path, SystemClock())
    noise = np.random.default_rng(1).integers(0, 256, 3000, np.uint8).tobytes()
    assert line.send(noise) == len(noise)
    with pytest.raises(SensorError, match="no rangefinder: check the port"):
        source.read()


def test_silence_is_an_error_that_says_so_and_ends_with_the_next_line(line: SerialLine) -> None:
    clock = SteppedClock(100.0)
    source = reopened(line, clock)
    with pytest.raises(SensorError, match="says nothing"):
        source.read()
    clock.sleep_until(200.0)
    source.open()
    line.say(1000, 900)
    assert source.read().line.distance_mm == 900


def test_a_flood_is_never_taken_for_now(line: SerialLine) -> None:
    clock = FakeClock(100.0)
    sonar = SerialSonar(line.path, clock)
    line.say(1000, 3000)
    eventually(lambda: sonar.read().distance_m == 3.0)
    # Two seconds later comes what was measured within the first tenth of a second.
    clock.advance(2.0)
    for index in range(1, 101):
        text = encoded(SonarLine(1000 + index, SonarKind.ECHO, 3000 - index))
        eventually(lambda text=text: line.send(text) == len(text))
    eventually(lambda: sonar.read().stamp_s == pytest.approx(100.1))
    assert sonar.read() == SonarReading(pytest.approx(100.1), SonarState.STALE)
    # What is measured now is read at once.
    line.say(3000, 700)
    eventually(lambda: sonar.read().distance_m == 0.7)
    sonar.close()


def test_unplugged_is_an_error_and_plugged_in_again_it_goes_on(line: SerialLine) -> None:
    clock = SteppedClock(100.0)
    source = reopened(line, clock)
    source.open()
    line.say(60_000, 900)
    assert source.read().line.distance_mm == 900
    line.unplug()
    with pytest.raises(SensorError, match="unplugged: plug it in"):
        source.read()
    clock.sleep_until(clock.now_s() + LONGEST_BACKOFF_S)
    with pytest.raises(SensorError, match="No rangefinder is found"):
        source.read()
    line.plug()
    clock.sleep_until(clock.now_s() + LONGEST_BACKOFF_S)
    # The microcontroller has lost its power: its time begins anew.
    source.open()
    line.say(40, 800)
    heard = source.read()
    assert (heard.stamp_s, heard.line.distance_mm) == (clock.now_s(), 800)


def test_a_line_that_is_not_there_is_told_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(SensorError, match="No rangefinder is found"):
        SerialSonar(str(tmp_path / "ttyUSB7"), SteppedClock())


def test_before_the_first_line_nothing_is_known(line: SerialLine) -> None:
    sonar = SerialSonar(line.path, FakeClock(5.0))
    assert sonar.read().state is SonarState.STALE
    sonar.close()


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        (SonarLine(0, SonarKind.ECHO, 1534), SonarReading(7.0, SonarState.OK, 1.534)),
        (SonarLine(0, SonarKind.ECHO, 4250), SonarReading(7.0, SonarState.OK, 4.25)),
        (SonarLine(0, SonarKind.ECHO, 6000), SonarReading(7.0, SonarState.NO_ECHO)),
        (SonarLine(0, SonarKind.NO_ECHO, 0), SonarReading(7.0, SonarState.NO_ECHO)),
    ],
)
def test_what_a_line_means(said: SonarLine, meant: SonarReading) -> None:
    assert reading_of(HeardLine(7.0, said)) == meant


def test_a_rangefinder_that_does_not_answer_its_microcontroller_is_an_error_not_a_free_way() -> None:
    with pytest.raises(SensorError, match="check the wires"):
        check_line(HeardLine(1.0, SonarLine(5, SonarKind.FAULT, 0)), None)


def test_a_line_that_is_repeated_is_an_error() -> None:
    same = SonarLine(5, SonarKind.ECHO, 900)
    for again in (HeardLine(1.0, same), HeardLine(2.0, same), HeardLine(0.5, SonarLine(4, SonarKind.ECHO, 900))):
        with pytest.raises(SensorError, match="old readings"):
            check_line(again, HeardLine(1.0, same))


# --------------------------------------------------------------------------------------------- in the whole loop
class Sequence:
    """A rangefinder that gives, one after the other, what it was told to."""

    def __init__(self, *readings: SonarReading | Exception) -> None:
        self._readings = iter(readings)

    def read(self) -> SonarReading:
        reading = next(self._readings)
        if isinstance(reading, Exception):
            raise reading
        return reading

    def close(self) -> None:
        """Nothing to close."""


def test_the_console_hears_why_the_rangefinder_failed_once_and_when_it_is_back() -> None:
    clock = SteppedClock(100.0)
    gone = SensorError("The rangefinder was unplugged: plug it in again.")
    heard = SonarReading(100.0, SonarState.NO_ECHO)
    sonar: Sonar = Sequence(heard, gone, gone, heard, heard)
    lens = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
    seen = [
        Frame(100.0 + 0.1 * index, np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 2.0, np.float32))
        for index in range(5)
    ]
    localizer = FakeLocalizer(lambda frame: Localization(frame.stamp_s, LocalizationQuality.LOST, None))
    uplink = FakeUplink()
    parts = DeviceParts(
        clock, FakeCamera(lens, clock, seen), sonar, FakeOutput(), uplink, lambda site, lens, settings: localizer
    )
    agent = DeviceAgent(parts, DeviceState(Settings(), PoiGraph(0, {}, {})), localizer)
    states = [agent.run_cycle().guidance.trace.sonar_state for _ in seen]
    assert SonarState.ABSENT in states[1:3]
    assert [text for _, kind, text in uplink.events if kind == "sensor"] == [
        "The rangefinder was unplugged: plug it in again.",
        "The rangefinder delivers again.",
    ]
