"""The process on the glasses: hardware, loop, watchdog and link, put together and taken apart again."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import zlib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace

import msgspec

from device_agent.adapters.clocks import SystemClock
from device_agent.adapters.fakes import NoUplink
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.calibration_store import CalibrationStore
from device_agent.consent_watch import ConsentWatch
from device_agent.device_options import DeviceOptions
from device_agent.device_store import DeviceStore
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.localization import NoMap, make_localizer
from device_agent.locating import Beside, InLine
from device_agent.logged_uplink import LoggedUplink
from device_agent.logs import log_files, off_the_terminal
from device_agent.map_download import staging_folder
from device_agent.map_walk.map_walks import DeviceMapWalks, WalkPlan
from device_agent.map_walk.walk_folder import walks_in
from device_agent.orders import Lead, Order
from device_agent.places import find_place
from device_agent.ports import Clock, LocalizerPort, Uplink
from device_agent.power_watch import PowerWatch
from device_agent.recording.tap import Tap
from device_agent.sensors import Hardware, open_hardware
from device_agent.service.notify import ServiceNotifier
from device_agent.sharing import NOTHING_SHARED, Consent, Privacy
from device_agent.simulation.pace import PacedClock, RealTimeUplink
from device_agent.single_core import use_one_core
from device_agent.state import DeviceState, MapWalkTold, Phrase
from device_agent.state_health import damages, refuse_unwritable
from device_agent.warm_up import warm_up
from navcore.calibration import Calibration
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.errors import InputError, SensorError
from navcore.folder_swap import recover
from navcore.modes import Mode
from navcore.obstacle.scan import scan
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.site import Site, map_checksum
from navcore.site_files import MANIFEST
from navcore.types import Frame
from navcore.wire import Accesses, MapWalkSeen, Say

_LONGEST_STEP_CYCLES = 1.5
"""Camera intervals that pass in the simulation, at the most, while the loop goes round once."""
_log = logging.getLogger(__name__)


def run_device(options: DeviceOptions, stopped: threading.Event) -> int:
    """Run until ``stopped`` is set, or (without a console) until the walk is over. Returns the exit code."""
    use_one_core()
    store = DeviceStore(options.state, options.site)
    store.clear_up([*walks_in(options.map_walks), *([options.record.folder] if options.record is not None else [])])
    site = _site(options, store)
    goal = find_place(site.poi_graph, options.to) if site is not None and options.to else None
    kept = _kept(options, store)
    settings = kept.settings
    real = SystemClock()
    paced = PacedClock(real, _LONGEST_STEP_CYCLES / options.rate_hz) if options.simulated else None
    clock: Clock = paced or real
    with ExitStack() as stack:
        stack.enter_context(log_files(options.state / "logs"))
        journal = None if options.console_url is None else _journal(store, kept, stack)
        for trouble in kept.troubles:
            _log.warning("%s", trouble)
        if options.buttons is not None and options.buttons.kind == "keyboard":
            # The keys and what the walker hears have the terminal to themselves; the log's file has the rest.
            stack.enter_context(off_the_terminal())
        warm_up()
        notifier = ServiceNotifier()
        stack.callback(notifier.stopping)
        hardware = open_hardware(options, settings, clock, stack)
        localizer = NoMap() if site is None else make_localizer(site, hardware.camera.intrinsics, settings)
        state = replace(
            _first_state(options, site, settings, kept.revision), calibration=kept.calibration,
            privacy=Privacy(kept.consent),
        )  # fmt: skip
        uplink = NoUplink() if journal is None else _link(options, store, kept, journal, real, stack)
        for trouble in [*kept.troubles, *filter(None, [store.went_back])]:
            uplink.event(real.now_s(), "mode", trouble[:500])
        tap = _tap(options, uplink, stack)
        logged = LoggedUplink(RealTimeUplink(uplink, paced) if paced else uplink)
        parts = DeviceParts(
            clock, hardware.camera, hardware.sonar, hardware.output, logged, make_localizer, store, options.device_id,
            hardware.apply, hardware.display, hardware.buttons, tap=tap, alive=notifier.alive,
            host=hardware.host,
            # The simulated world waits for a slow loop.
            plans_load=not options.simulated, locating=InLine if options.simulated else Beside,
        )  # fmt: skip
        walks = _map_walks(options, hardware, lambda order: agent.submit(order), uplink, paced)
        stack.callback(walks.close)
        rehearsed = _rehearse(hardware, localizer, settings)
        if rehearsed is not None:
            tap.rehearsed(rehearsed)
        agent = DeviceAgent(replace(parts, map_walks=walks), state, localizer)
        if site is None:
            agent.submit(MapWalkTold(CueKind.MAP_NEWS, (Phrase("map_none"),)))
        if kept.troubles:
            agent.submit(Say(TEXTS[settings.cues.language]["storage_trouble"]))
        _take_up_privacy(options, store, kept, agent, stack)
        _watch_power(hardware, agent, real, stack)
        walks.take_up(settings)
        if isinstance(uplink, ConsoleLink):
            agent.announce()
            uplink.start(agent)
        if goal is not None:
            agent.submit(Lead(goal.id))
        ends_itself = goal is not None and options.console_url is None
        agent.run(stopped, until_over=ends_itself)
        return 0 if not ends_itself or agent.state.purpose is Mode.ARRIVED or stopped.is_set() else 1


@dataclass(frozen=True, slots=True)
class _Kept:
    """What the device's own folder had to give, and what is wrong with it."""

    settings: Settings
    revision: int
    calibration: Calibration
    consent: Consent
    consent_stamp: tuple[int, int] | None
    """Of its file, before that was read."""
    accesses: Accesses | None
    writable: bool
    troubles: list[str]
    """Each says what is wrong and what to do; guidance goes on without what they tell of."""


def _kept(options: DeviceOptions, store: DeviceStore) -> _Kept:
    troubles, writable = [], True
    try:
        refuse_unwritable(options.state)
    except InputError as error:
        writable = False
        troubles.append(f"{error} Until then settings, events, calibration and logs of this device are not kept.")
    troubles += [str(damage) for damage in damages(store)]
    settings, revision = store.load_settings()
    stored, error_of_calibration = CalibrationStore(options.state).load_or_kept()
    if error_of_calibration is not None:
        runs = "none runs, and a camera that has moved is not noticed" if stored is None else (
            f"revision {stored.revision} runs"
        )  # fmt: skip
        troubles.append(f"{error_of_calibration} Until then {runs}.")
    calibration = Calibration() if stored is None else stored.calibration
    consent_stamp = store.consent_stamp()
    consent, accesses = _consent(options, store), None
    with contextlib.suppress(InputError):
        accesses = store.load_accesses(time.time())
    return _Kept(
        settings.changed(options.changes), revision, calibration, consent, consent_stamp, accesses, writable, troubles
    )


def _default_consent(options: DeviceOptions) -> Consent:
    return Consent(walks=options.shares_walks, version=0)


def _consent(options: DeviceOptions, store: DeviceStore) -> Consent:
    """Return what is shared. Where nobody has said it, this start's own default is kept: `vbr consent` shows it."""
    default = _default_consent(options)
    try:
        kept = store.load_consent(default)
    except InputError:
        return NOTHING_SHARED
    if kept.version > 0:
        return kept
    with contextlib.suppress(OSError):
        # Told already, where the folder cannot be written.
        return store.change_consent(lambda kept: default if kept.version == 0 else kept, default)
    return default


def _take_up_privacy(
    options: DeviceOptions, store: DeviceStore, kept: _Kept, agent: DeviceAgent, stack: ExitStack
) -> None:
    """Let the walker hear who has looked, also before there is a link; and heed what is said by ``vbr consent``."""
    if kept.accesses is not None:
        agent.submit(kept.accesses)
    watch = ConsentWatch(store, _default_consent(options), agent.submit, kept.consent_stamp)
    stack.callback(watch.stop)
    watch.start()


def _watch_power(hardware: Hardware, agent: DeviceAgent, clock: Clock, stack: ExitStack) -> None:
    """Let the walker hear when the battery ends, or the glasses get hot."""

    def say(key: str) -> None:
        agent.submit(Say(TEXTS[agent.state.settings.cues.language][key]))

    watch = PowerWatch(hardware.host.read, lambda: agent.state.mode is not Mode.OFF_DUTY, say, clock.now_s)
    stack.callback(watch.stop)
    watch.start()


def _site(options: DeviceOptions, store: DeviceStore) -> Site | None:
    """Return the map to walk in; None where there is none and one is to be recorded. Raises SiteError, InputError."""
    recover(options.site)
    if not options.without_map or (options.site / MANIFEST).exists():
        return store.load_map()
    if options.to:
        raise InputError("Nobody can be led where there is no map yet: leave --to out, and record a map walk first.")
    return None


def _first_state(options: DeviceOptions, site: Site | None, settings: Settings, revision: int) -> DeviceState:
    if site is None:
        return DeviceState(settings, PoiGraph(), settings_revision=revision, mode=Mode.OFF_DUTY)
    return DeviceState(
        settings, site.poi_graph, site.site_id, map_checksum(options.site), settings_revision=revision,
        promised_ready=True,
    )  # fmt: skip


def _rehearse(hardware: Hardware, localizer: LocalizerPort, settings: Settings) -> Frame | None:
    """Work on one picture before anybody is led: the first one takes longer than the watchdog allows. Return it."""
    with contextlib.suppress(SensorError):
        frame = hardware.camera.read()
        located = localizer.locate(frame)
        scan(frame.depth_m, hardware.camera.intrinsics, located.world_from_camera, settings.obstacle)
        return frame
    return None


def _map_walks(
    options: DeviceOptions,
    hardware: Hardware,
    submit: Callable[[Order], None],
    uplink: Uplink,
    paced: PacedClock | None,
) -> DeviceMapWalks:
    plan = WalkPlan(options.map_walks, options.site, owns_map=options.console_url is None)
    if not isinstance(uplink, ConsoleLink):
        return DeviceMapWalks(plan, hardware.camera.intrinsics, make_localizer, submit)

    def show(seen: MapWalkSeen) -> None:
        uplink.map_walk(seen if paced is None else msgspec.structs.replace(seen, stamp_s=paced.real_s(seen.stamp_s)))

    return DeviceMapWalks(
        plan, hardware.camera.intrinsics, make_localizer, submit, show=show, handed_over=uplink.recording_waits
    )


def _tap(options: DeviceOptions, uplink: Uplink, stack: ExitStack) -> Tap:
    """Return what listens in on the loop: a recorder that writes beside it, where one is wanted."""
    if options.record is None:
        return Tap()
    from device_agent.recording.recorder import WalkRecorder

    recorder = WalkRecorder(replace(options.record, map_walks=options.map_walks))
    if isinstance(uplink, ConsoleLink):
        recorder.files.on_finished = uplink.recording_waits
        uplink.open_walk = lambda: recorder.files.path
    stack.callback(recorder.close)
    recorder.start()
    return recorder


def _journal(store: DeviceStore, kept: _Kept, stack: ExitStack) -> EventJournal:
    """Return the journal of events; one in memory where the disk takes none."""
    try:
        journal = EventJournal(store.journal_path)
    except InputError as error:
        if kept.writable:
            kept.troubles.append(f"{error} Until then events wait in memory, and are lost when the device ends.")
        journal = EventJournal(None)
    stack.callback(journal.close)
    if journal.damaged is not None:
        kept.troubles.append(
            f"The event journal was damaged and is kept as {journal.damaged.name}: events in it may be untold."
        )
    return journal


def _link(
    options: DeviceOptions, store: DeviceStore, kept: _Kept, journal: EventJournal, clock: Clock, stack: ExitStack
) -> ConsoleLink:
    assert options.console_url is not None, "a journal is kept for a console alone"
    settings = LinkSettings(
        options.console_url, options.token, staging_folder(options.site), options.tls,
        seed=zlib.crc32(options.device_id.encode()), map_walks=options.map_walks,
        walks=options.record.folder if options.record is not None else None,
    )  # fmt: skip
    link = ConsoleLink(settings, journal, clock)
    if kept.writable:
        link.on_link_state = store.save_link_state
    stack.callback(link.stop)
    return link
