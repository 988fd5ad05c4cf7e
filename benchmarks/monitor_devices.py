"""Simulated devices that really dial a console: what they send is told by the message table, and by a walk's rhythm.

Each state carries the time of its capture, on this machine's monotonic clock, in the text of its last cue: whoever
reads it at the other end, on the same machine, knows its true age.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import time
from dataclasses import dataclass, field

import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from navcore.modes import Mode
from navcore.settings import Settings
from navcore.silhouette import silhouette_jpeg
from navcore.wire import (
    MESSAGES,
    PROTOCOL_VERSION,
    DepthImage,
    Event,
    EventConfirmed,
    Hello,
    Ping,
    Pong,
    RouteChanged,
    SettingsRunning,
    WalkerState,
    WireCandidate,
    decode_from_console,
    decode_welcome,
    encode,
)
from navcore.wire_pace import BURST_S, Pace
from navcore.wire_trace import DecisionTraceView, WireScan

CAPTURED = "captured at "
EVENT_EVERY_S = 2.0
"""In a walk something is said about so often."""
_TRACE = DecisionTraceView(
    "theta_opt", optimal_rad=0.05, required_m=2.0, valid_fraction=0.9,
    scan=WireScan(-0.45, 0.0145, (1,) * 63, tuple(range(180, 495, 5))),
)  # fmt: skip
"""As large as that of a real depth image."""
_JPEG = silhouette_jpeg(np.random.default_rng(0).uniform(0.5, 5.0, (60, 80)).astype(np.float32))
"""Some kilobytes: noise, which hardly gets smaller."""
_CONFIRM_WITHIN_S = 30.0


def captured_s(last_cue: str) -> float | None:
    """Return when the state of this last cue was captured (monotonic clock); None where it does not say."""
    return float(last_cue.removeprefix(CAPTURED)) if last_cue.startswith(CAPTURED) else None


@dataclass
class Told:
    """What one device has sent, and what it was answered."""

    device_id: str
    states_count: int = 0
    events_count: int = 0
    confirmed_sequence: int = 0
    links_count: int = 0
    last_break: str = ""
    slowest_confirmation_s: float = 0.0
    _sent_s: dict[int, float] = field(default_factory=dict)

    def next_event(self) -> Event:
        """Return the next event; from now on it waits for its confirmation."""
        self.events_count += 1
        now_s = self._sent_s[self.events_count] = time.monotonic()
        return Event(self.events_count, now_s, "cue", f"Move forward, {self.events_count}.")

    def confirmed(self, sequence: int) -> None:
        """Note that all events up to this one are stored."""
        now_s, self.confirmed_sequence = time.monotonic(), max(self.confirmed_sequence, sequence)
        for number in [number for number in self._sent_s if number <= sequence]:
            self.slowest_confirmation_s = max(self.slowest_confirmation_s, now_s - self._sent_s.pop(number))

    def unconfirmed(self) -> list[Event]:
        """Return the events that a device would keep on its disk."""
        return [Event(number, at_s, "cue", f"Move forward, {number}.") for number, at_s in self._sent_s.items()]


class Device:
    """One device with its token."""

    def __init__(self, url: str, token: str, told: Told) -> None:
        self._url, self._headers, self.told = f"{url}/device", {"Authorization": f"Bearer {token}"}, told

    async def walk(self, seconds: float, rate_hz: float) -> Told:
        """Be led for so long, decide ``rate_hz`` times a second, and tell as often as the table allows.

        A link that breaks is dialled again. Returns once every event is confirmed, or half a minute later.
        """
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s + _CONFIRM_WITHIN_S:
            try:
                async with self._joined() as socket:
                    await self._tell(socket, until_s, rate_hz)
                    return self.told
            except (OSError, WebSocketException, TimeoutError) as error:
                self.told.last_break = f"{type(error).__name__}: {error}"
                await asyncio.sleep(0.5)
        return self.told

    async def burst(self) -> None:
        """Tell as much as a network may deliver at once after a jam, and leave: half a minute of a walk in a moment."""
        async with self._joined() as socket:
            rates_hz = {kind: MESSAGES[kind].rate_hz or 0.0 for kind in (WalkerState, DepthImage)}
            states_count = int(BURST_S * rates_hz[WalkerState])
            image_every = round(rates_hz[WalkerState] / rates_hz[DepthImage])
            event_every = round(EVENT_EVERY_S * rates_hz[WalkerState])
            for number in range(states_count):
                await socket.send(encode(self._state(time.monotonic())))
                if number % image_every == 0:
                    await socket.send(encode(DepthImage(time.monotonic(), _JPEG)))
                if number % event_every == 0:
                    await socket.send(encode(self.told.next_event()))
            await self._all_confirmed()

    @contextlib.asynccontextmanager
    async def _joined(self):  # type: ignore[no-untyped-def]
        async with connect(self._url, additional_headers=self._headers, proxy=None, compression=None) as socket:
            now_s = time.monotonic()
            hello = Hello(PROTOCOL_VERSION, self.told.device_id, "benchmark", "corridor", "none", 1, 0, now_s)
            await socket.send(encode(hello))
            decode_welcome(bytes(await socket.recv()))
            self.told.links_count += 1
            answers = asyncio.create_task(self._answer(socket))
            try:
                await socket.send(encode(SettingsRunning(0, Settings().values())))
                route = RouteChanged(now_s, ((0.0, 0.0), (30.0, 0.0)), (("Bar", 30.0),), "bar")
                await socket.send(encode(route))
                for event in self.told.unconfirmed():
                    await socket.send(encode(event))
                yield socket
            finally:
                answers.cancel()
                await asyncio.gather(answers, return_exceptions=True)

    async def _tell(self, socket: ClientConnection, until_s: float, rate_hz: float) -> None:
        paces = {kind: Pace(MESSAGES[kind].rate_hz or rate_hz) for kind in (WalkerState, DepthImage)}
        event_due_s = began_s = time.monotonic()
        for number in itertools.count(1):
            captured = time.monotonic()
            if captured >= until_s:
                break
            for kind, message in ((WalkerState, self._state(captured)), (DepthImage, DepthImage(captured, _JPEG))):
                if paces[kind].wait_s(captured) <= 0.0:
                    paces[kind].went(captured)
                    await socket.send(encode(message))
                    self.told.states_count += kind is WalkerState
            if captured >= event_due_s:
                event_due_s += EVENT_EVERY_S
                await socket.send(encode(self.told.next_event()))
            await asyncio.sleep(max(0.0, began_s + number / rate_hz - time.monotonic()))
        await self._all_confirmed()

    async def _all_confirmed(self) -> None:
        async with asyncio.timeout(_CONFIRM_WITHIN_S):
            while self.told.confirmed_sequence < self.told.events_count:
                await asyncio.sleep(0.02)

    async def _answer(self, socket: ClientConnection) -> None:
        async for data in socket:
            came_s = time.monotonic()
            match decode_from_console(bytes(data)):  # type: ignore[arg-type]
                case Ping(console_sent_s):
                    await socket.send(encode(Pong(console_sent_s, came_s, time.monotonic())))
                case EventConfirmed(sequence):
                    self.told.confirmed(sequence)
                case _:
                    pass

    def _state(self, stamp_s: float) -> WalkerState:
        x_m = 15.0 + 14.0 * ((stamp_s / 20.0) % 2.0 - 1.0)
        candidates = tuple(WireCandidate(-0.4 + 0.05 * n, 3.0) for n in range(17))
        return WalkerState(
            stamp_s, "localized", "walk", "ok", rule="theta_opt", pose=(x_m, 0.1, 1.6, 0.0), position_std_m=0.03,
            inlier_count=120, direction_rad=0.05, expected_rad=0.02, sub_goal=(x_m + 2.0, 0.0), sub_goal_case=1,
            candidates=candidates, deviation_m=0.1, remaining_m=30.0 - x_m, nearest_ahead_m=3.2, sonar_state="ok",
            sonar_m=3.1, speed_m_s=0.8, last_cue=f"{CAPTURED}{stamp_s:.4f}", last_cue_stamp_s=stamp_s, cycle_ms=12.0,
            frame_rate_hz=20.0, mode=Mode.GUIDING, destination_id="bar", trace=_TRACE,
        )  # fmt: skip


def walk_all(url: str, tokens: list[str], seconds: float, rate_hz: float) -> list[Told]:
    """Let all walk at once, in this process; the first begins at once, the others within a second."""

    async def one(number: int, token: str) -> Told:
        await asyncio.sleep(number / len(tokens))
        return await Device(url, token, Told(f"glasses-{number}")).walk(seconds, rate_hz)

    async def every() -> list[Told]:
        return await asyncio.gather(*(one(number, token) for number, token in enumerate(tokens)))

    return asyncio.run(every())


def burst_all(url: str, token: str, minutes: float, told: Told) -> Told:
    """Tell so many minutes of a walk as fast as they are taken in, after what was told before."""
    device = Device(url, token, told)

    async def all_bursts() -> None:
        for _ in range(round(60.0 * minutes / BURST_S)):
            await device.burst()

    asyncio.run(all_bursts())
    return device.told
