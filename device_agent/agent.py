"""The device agent: one loop, one core, from the sensors to the cue.

:meth:`DeviceAgent.run_cycle` is one cycle. A lock-step driver calls it with a simulated clock; :meth:`DeviceAgent.run`
calls it live, with the watchdog in a thread of its own. Orders come in through :meth:`DeviceAgent.submit` from any
thread and are carried out between two frames.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path

from device_agent.adapters.fakes import FakeHost, NoButtons, NoMapWalks
from device_agent.cycle import Cycle, walker_state
from device_agent.device_store import DeviceStore
from device_agent.load_plan import LoadLevel
from device_agent.locating import DirectLocator, InLine
from device_agent.loop import Ports, run_stages
from device_agent.loop_monitor import LoopMonitor
from device_agent.menu import pressed
from device_agent.orders import Order, at_rest, carry_out
from device_agent.ports import (
    ButtonPress,
    Buttons,
    Clock,
    CueOutput,
    DepthCamera,
    DisplayOutput,
    HostMonitor,
    LocalizerPort,
    MapWalks,
    Sonar,
    Uplink,
)
from device_agent.privacy import heard, passed, sharing_of
from device_agent.recording.tap import Tap
from device_agent.screen import Screen
from device_agent.settings_trial import after_trial, running
from device_agent.stage_statistics import as_text
from device_agent.state import (
    DeviceState,
    Effect,
    Happened,
    MarkPlace,
    Notice,
    Outdated,
    PreparedMap,
    RunSettings,
    SayAgain,
    SoundSign,
    StoreAccesses,
    StoreConsent,
    StoreGraph,
    StoreSettings,
    SwapMap,
)
from device_agent.voice import Voice, VoiceMemory
from device_agent.watchdog import Heartbeat, Watchdog
from navcore.cues.table import Cue
from navcore.errors import SensorError, SiteError, VbrError
from navcore.modes import Mode
from navcore.settings import Settings
from navcore.site import Site, load_site
from navcore.types import Action, CameraIntrinsics
from navcore.wire import PROTOCOL_VERSION, ConsoleMessage, GraphRunning, Hello, MapRunning, MapWalkRunning, expired_text
from navcore.wire import Order as PersonsOrder

MAX_WAITING_ORDERS = 256
ORDERS_A_CYCLE = 16
"""Guidance goes on between so many orders, however many come."""
_PAUSE_WITHOUT_CAMERA_S = 0.05
_STANDING_TIMEOUT_S = 3.0
"""A loop that has said *Stop* may take this long for its next cycle: looking for a lost pose is slow."""
HANGS_AFTER_S = 8.0
"""A localizer that has not answered for so long will not answer."""
_log = logging.getLogger(__name__)

LocalizerFactory = Callable[[Site, CameraIntrinsics, Settings], LocalizerPort]


@dataclass(frozen=True, slots=True, eq=False)
class DeviceParts:
    """What the agent is put together from."""

    clock: Clock
    camera: DepthCamera
    sonar: Sonar
    output: CueOutput
    uplink: Uplink
    make_localizer: LocalizerFactory
    store: DeviceStore | None = None
    """Where settings, graph and map are kept; None keeps nothing."""
    device_id: str = "glasses"
    apply_settings: Callable[[Settings], None] = lambda settings: None
    """Hears of every change of the settings, besides the loop."""
    display: DisplayOutput | None = None
    """The displays of the glasses, where there are any."""
    buttons: Buttons = field(default_factory=NoButtons)
    """What the walker can press."""
    timer_s: Callable[[], float] = time.perf_counter
    """Measures how long the stages take, seconds."""
    locating: Callable[[LocalizerPort], DirectLocator] = InLine
    """How localizers are asked. In line in lock step, where the same walk must come out however slow the machine is."""
    plans_load: bool = False
    """Less is done where the loop is too slow. Not in lock step, where time does not pass by this machine's speed."""
    tap: Tap = field(default_factory=Tap)
    """Who listens in on the loop: a recorder, or nobody."""
    alive: Callable[[], None] = lambda: None
    """Called after each cycle in which nothing was raised: a sign of life for whoever starts the device anew."""
    map_walks: MapWalks = field(default_factory=NoMapWalks)
    """What records a map walk while the state is *mapping*."""
    host: HostMonitor = field(default_factory=FakeHost)
    """Battery and temperature; of what is simulated or replayed, nothing is known."""


class DeviceAgent:
    """Runs the loop over its parts; everything that it remembers is one frozen :class:`DeviceState`."""

    def __init__(
        self, parts: DeviceParts, state: DeviceState, localizer: LocalizerPort, voice: VoiceMemory | None = None
    ) -> None:
        """``state`` and ``voice`` are what is remembered: of nothing at a start, of an earlier moment in a replay."""
        self._tap = parts.tap
        self._parts = parts = replace(parts, uplink=self._tap.uplink(parts.uplink))
        self._clock = self._tap.clock(parts.clock)
        self.state = state
        """Replaced as a whole, between two stages: any thread may read it."""
        self._locator = parts.locating(localizer)
        self._orders: queue.Queue[tuple[Order, float]] = queue.Queue()
        """Each with the time until which it may be carried out."""
        self.monitor = LoopMonitor(plans=parts.plans_load)
        """How long the stages take."""
        self._frame_rate_hz = 0.0
        self._last_stamp_s: float | None = None
        self._quality = ""
        self._maps = False
        self._buttons_gone = False
        self._disk = ThreadPoolExecutor(1, "disk")
        """Writes what must not hold up whoever is being led."""
        self._version = metadata.version("virtual-blind-road")
        self.watchdog = Watchdog(
            parts.clock,
            self._tap.watchdog_output(parts.output),
            lambda stamp_s, text: parts.uplink.event(stamp_s, "watchdog", text),
            lambda: self.state.settings.cues.language,
        )
        stop_count = self._tap.stop_count(lambda: self.watchdog.stop_count)
        self._voice = Voice(self._tap.voice_output(parts.output), stop_count)
        if voice is not None:
            self._voice.go_on_from(voice)
        self.screen = (
            None
            if parts.display is None
            else Screen(parts.display, parts.clock, state.settings, lambda: self.watchdog.alarmed)
        )
        """What the walker sees, where there is a display."""
        self._tap.begin(self.state, self._voice.memory, parts.camera.intrinsics)

    # ------------------------------------------------------------------------------------------------- orders
    def submit(self, order: Order, holds_s: float = math.inf) -> None:
        """Take an order from any thread, which is carried out within ``holds_s`` or not at all.

        Raises VbrError when far too many of the console's wait already; what the device tells itself (the link has
        broken) is taken in any case.
        """
        if isinstance(order, ConsoleMessage) and self._orders.qsize() >= MAX_WAITING_ORDERS:
            raise VbrError("The device is too busy to take more orders: try again.")
        self._orders.put_nowait((order, self._parts.clock.now_s() + holds_s))

    def hello(self) -> Hello:
        """Return who this device is and what it runs."""
        state = self.state
        return Hello(
            PROTOCOL_VERSION, self._parts.device_id, self._version, state.site_id, state.map_checksum,
            state.graph.version, state.settings_revision, self._parts.clock.now_s(),
        )  # fmt: skip

    def map_arrived(self, staging: Path, checksum: str) -> None:
        """Load a map that was fetched; called by the link's worker, so that the loop does not wait. Raises VbrError."""
        site = load_site(staging)
        localizer = self._parts.make_localizer(site, self._parts.camera.intrinsics, self.state.settings)
        self.submit(PreparedMap(staging, checksum, site, localizer))

    def announce(self) -> None:
        """Tell the console, once it is there, what runs."""
        state, uplink = self.state, self._parts.uplink
        uplink.message(running(state))
        uplink.message(GraphRunning(state.graph.version))
        uplink.message(MapRunning(state.map_checksum))
        uplink.message(MapWalkRunning(state.purpose is Mode.MAPPING))
        uplink.message(sharing_of(state.privacy))

    # -------------------------------------------------------------------------------------------------- loop
    def run(self, stopped: threading.Event, *, until_over: bool = False) -> None:
        """Run live at the camera's rate until ``stopped``; with ``until_over``, until nobody is led any more."""
        try:
            while not stopped.is_set():
                cycle = self.run_cycle()
                self.watchdog.start()
                if self.screen is not None:
                    self.screen.start()
                if until_over and not self.state.leading:
                    break
                if cycle.frame is None:
                    # A camera that fails at once must not turn the loop into a busy one.
                    stopped.wait(_PAUSE_WITHOUT_CAMERA_S)
        finally:
            self.watchdog.stop()
            if self.screen is not None:
                self.screen.stop()
            if self.state.on_the_way:
                # Whoever still walks hears that nobody leads them any more.
                self.watchdog.fault("The loop has ended.")
            self._locator.close()
            self.settle()

    def run_cycle(self) -> Cycle:
        """Run once from the sensors to the cues; whatever is raised on the way becomes *Stop*, never the end."""
        self._tap.cycle_begins()
        self._guarded("taking orders", self._take_orders)
        self._take_load_level()
        parts = self._parts
        ports = Ports(
            self._clock, parts.camera, parts.sonar, self._locator, self._voice, lambda: self.watchdog.stale_s,
            timer_s=parts.timer_s,
        )  # fmt: skip
        self.state, cycle, effects = run_stages(self.state, self._tap.ports(ports))
        self.state = heard(self.state, cycle.cues)
        cued_s, began_s = parts.clock.now_s(), parts.timer_s()
        if cycle.fault:
            self.watchdog.fault(cycle.fault)
        else:
            self.watchdog.beat(self._heartbeat(cycle))
        if self.screen is not None:
            self.screen.offer(cycle, self.state.settings)
        self._guarded("acting on the cycle", lambda: self._do_all(effects))
        self._guarded("recording the map walk", lambda: self._follow_map_walk(cycle))
        try:
            self._report(cycle)
        except Exception:
            # What the console shows is nothing that the walker's guidance may hang on.
            _log.exception("a cycle could not be reported")
        self._tap.cycle_ended(self.state, self._voice.memory, cycle)
        self.monitor.note(cycle, cued_s, parts.timer_s() - began_s, self.state.settings.deadlines)
        if not cycle.fault and not self._localizer_hangs(cycle.stamp_s):
            self._parts.alive()
        return cycle

    def _localizer_hangs(self, now_s: float) -> bool:
        """Whether the localizer will not answer any more: only a new process helps, and the service begins one."""
        since_s = self._locator.working_since_s
        return since_s is not None and now_s - since_s > HANGS_AFTER_S

    def _take_load_level(self) -> None:
        """Leave out of this cycle what the cycles before had no time for; say so when that changes."""
        level = self._tap.load_level(self.monitor.level)
        if level is self.state.load_level:
            return
        self.state = replace(self.state, load_level=level)
        _log.warning("%s %s", LOAD_TEXTS[level], as_text(self.monitor.summaries))
        self._parts.uplink.event(self._parts.clock.now_s(), "mode", LOAD_TEXTS[level])

    def _follow_map_walk(self, cycle: Cycle) -> None:
        """A map walk is recorded while, and only while, the state says so, whatever has led there or away."""
        maps, walks = self.state.purpose is Mode.MAPPING, self._parts.map_walks
        if maps and not self._maps:
            walks.begin(self.state.settings)
        if maps and cycle.frame is not None:
            walks.take(cycle.frame)
        if self._maps and not maps:
            walks.end()
        self._maps = maps

    def _guarded(self, what: str, work: Callable[[], None]) -> None:
        """Do what stands about the loop; where it raises, the walker is stopped, and the loop goes on."""
        try:
            work()
        except Exception as error:
            _log.exception("%s failed", what)
            self.state = replace(self.state, failed_s=self._clock.now_s())
            self.watchdog.fault(f"{what} failed: {type(error).__name__}: {error}"[:500])

    def _heartbeat(self, cycle: Cycle) -> Heartbeat:
        """A stop is right however old its picture is, and has been heard; only a loop that is gone is told of then."""
        leading = self.state.on_the_way
        if cycle.guidance.action is Action.STOP:
            return Heartbeat(self._clock.now_s(), leading, _STANDING_TIMEOUT_S)
        return Heartbeat(cycle.stamp_s, leading, self.state.settings.watchdog.guidance_timeout_s)

    def _take_orders(self) -> None:
        for _ in range(min(ORDERS_A_CYCLE, self._orders.qsize())):
            order, until_s = self._orders.get_nowait()
            now_s = self._parts.clock.now_s()
            if isinstance(order, PersonsOrder) and now_s > until_s:
                self._parts.uplink.event(now_s, "link", expired_text(order))
            else:
                self._carry_out(order)
        for press in self._presses():
            self._carry_out(press)
        if self.state.trial is not None:
            self.state, effects = after_trial(self.state, self._clock.now_s())
            self._do_all(effects)
        self.state, effects = at_rest(self.state)
        self._do_all(effects)
        if not self.state.privacy.at_rest:
            self.state, effects = passed(self.state, self._clock.now_s())
            self._do_all(effects)

    def _carry_out(self, order: Order) -> None:
        self._tap.order(order)
        now_s = self._clock.now_s()
        if isinstance(order, ButtonPress):
            self.state, effects = pressed(self.state, order, now_s)
        else:
            self.state, effects = carry_out(self.state, order, now_s)
        self._do_all(effects)

    def _presses(self) -> tuple[ButtonPress, ...]:
        try:
            presses = self._parts.buttons.pressed()
        except SensorError as error:
            if not self._buttons_gone:
                self._parts.uplink.event(self._parts.clock.now_s(), "sensor", str(error)[:500])
            self._buttons_gone = True
            return ()
        self._buttons_gone = False
        return presses

    # ----------------------------------------------------------------------------------------------- effects
    def _do_all(self, effects: tuple[Effect, ...]) -> None:
        for effect in effects:
            self._do(effect)

    def _do(self, effect: Effect) -> None:
        now_s = self._clock.now_s()
        match effect:
            case Notice():
                self._heard(self._voice.say(effect, self.state.settings, now_s))
            case SayAgain():
                self._heard(self._voice.repeat(self.state, effect.otherwise, now_s))
            case SoundSign():
                self._heard(self._voice.sound(effect.tone, self.state.settings, now_s))
            case Outdated():
                self._voice.forget(effect.kinds)
            case MarkPlace():
                self._parts.map_walks.mark(effect.name)
            case Happened():
                self._parts.uplink.event(now_s, effect.kind, effect.text)
            case SwapMap():
                # What the other map's localizer may still say is of another place.
                self._locator.close()
                self._locator = self._parts.locating(effect.prepared.localizer)
                self._locator.apply(self.state.settings)
                self._disk.submit(self._keep, lambda store: store.swap_map(effect.prepared.staging))
            case RunSettings():
                self._locator.apply(effect.settings)
                self._parts.apply_settings(effect.settings)
            case StoreGraph() | StoreSettings() | StoreConsent() | StoreAccesses():
                # One thread writes all of it, in order: a graph after the map that it may be of.
                self._disk.submit(self._keep, lambda store: _write(store, effect))
            case _:
                self._parts.uplink.message(effect)

    def _keep(self, work: Callable[[DeviceStore], None]) -> None:
        if self._parts.store is None:
            return
        try:
            work(self._parts.store)
        except (OSError, SiteError) as error:
            text = f"What runs now could not be kept for the next start ({error}): free the disk."
            _log.warning("%s", text)
            self._parts.uplink.event(self._parts.clock.now_s(), "mode", text)

    def settle(self) -> None:
        """Return when all that is to be kept is on the disk."""
        self._disk.submit(lambda: None).result()

    def _report(self, cycle: Cycle) -> None:
        """Leave with the uplink what the console shows, and what must not be lost."""
        uplink = self._parts.uplink
        self._measure_rate(cycle)
        spoken, summaries = self._voice.last_spoken, self.monitor.summaries
        health = self._parts.host.read()
        uplink.state(walker_state(self.state, cycle, spoken, self._frame_rate_hz, summaries, health))
        if cycle.frame is not None:
            uplink.depth_image(cycle.frame)
            if self.state.privacy.colour is not None:
                uplink.colour_image(cycle.frame)
        self._report_cues(cycle.cues)
        quality = cycle.localization.quality.value if cycle.localization is not None else self._quality
        if quality != self._quality:
            self._quality = quality
            uplink.event(cycle.stamp_s, "localization", f"The place in the map is {_QUALITY_WORDS[quality]}.")

    def _heard(self, cues: tuple[Cue, ...]) -> None:
        self.state = heard(self.state, cues)
        self._report_cues(cues)

    def _report_cues(self, cues: tuple[Cue, ...]) -> None:
        for cue in cues:
            if cue.text:
                self._parts.uplink.event(cue.stamp_s, "cue", cue.text[:500])

    def _measure_rate(self, cycle: Cycle) -> None:
        if cycle.frame is None:
            self._last_stamp_s, self._frame_rate_hz = None, 0.0
            return
        before_s, self._last_stamp_s = self._last_stamp_s, cycle.stamp_s
        if before_s is not None and cycle.stamp_s > before_s:
            rate_hz = 1.0 / (cycle.stamp_s - before_s)
            share = 0.1 if self._frame_rate_hz > 0 else 1.0
            self._frame_rate_hz += share * (rate_hz - self._frame_rate_hz)


LOAD_TEXTS = {
    LoadLevel.FULL: "The device is fast enough again: nothing is left out.",
    LoadLevel.FEWER_FEATURES: "The device is too slow: localization uses fewer features.",
    LoadLevel.HALF_RATE: "The device is too slow: localization uses every second picture.",
}
"""What the console is told of a level."""
_QUALITY_WORDS = {"localized": "known", "uncertain": "uncertain", "lost": "lost"}


def _write(store: DeviceStore, effect: StoreGraph | StoreSettings | StoreConsent | StoreAccesses) -> None:
    match effect:
        case StoreGraph():
            store.save_graph(effect.graph)
        case StoreSettings():
            store.save_settings(effect.settings, effect.revision)
        case StoreConsent():
            store.save_consent(effect.consent)
        case StoreAccesses():
            store.save_accesses(effect.accesses)
