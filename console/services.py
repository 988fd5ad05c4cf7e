"""Everything that the console's routes work with, put together once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from console.access import AccessLog
from console.accounts import Accounts
from console.alerts.alert_store import AlertStore
from console.alerts.alerts import Alerts
from console.alerts.incidents import Incidents
from console.checks import MapChecks
from console.config import ConsoleConfig
from console.device_store import DeviceStore
from console.exports import Exports
from console.hub import DeviceHub
from console.incident_timeline import IncidentTimelines
from console.late_audit import WRITE_EVERY_S, LateAudit
from console.live import EVENTS_KEPT_COUNT, Command
from console.map_builds import MapBuilds
from console.map_package import MapPackage
from console.model import ModelChange, SiteModel
from console.past_walks import PastWalks
from console.presence import Presence
from console.presets import Presets
from console.recordings import Recordings
from console.rehearsals import Rehearsals, Sounds
from console.retention import EVERY_S, DeleteBefore, Retention
from console.settings_store import SettingsStore
from console.site_imports import SiteImports
from console.sockets import LOOK_EVERY_S as LOOK_WHO_IS_SIGNED_IN_EVERY_S
from console.sockets import SessionSockets, close_what_is_over
from console.store import Store
from console.surveys import Surveys
from console.tuning import Tuning
from console.view_requests import ViewRequests
from console.walk_library import WalkLibrary
from console.watching import LOOK_EVERY_S, Watching
from console.what_if import WhatIfs
from navcore.repeating import Repeating
from navcore.settings import SettingValue

SEE_TO_ROOM_EVERY_S = 5.0
"""People see on every page what was found last."""


@dataclass(frozen=True, slots=True)
class Services:
    """The parts behind the routes; also ``app.state.services``."""

    config: ConsoleConfig
    store: Store
    accounts: Accounts
    devices: DeviceStore
    model: SiteModel
    hub: DeviceHub
    presence: Presence
    """Who looks at the map, and at what."""
    views: ViewRequests
    """Requests of a page to the 3D scene inside it."""
    sockets: SessionSockets
    """What to close when a session ends."""
    device_sockets: SessionSockets
    """What to close when a device's token is void."""
    close_void_links: Callable[[], None]
    """Ends the links of devices whose token is void: called at once after a token was revoked or replaced."""
    package: MapPackage
    settings: SettingsStore
    """What devices were asked to run."""
    presets: Presets
    """Named sets of values."""
    tuning: Tuning
    """The one way to change settings of a device: checked, numbered, audited."""
    what_ifs: WhatIfs
    """What other settings would have changed in past walks."""
    recordings: Recordings
    """What devices have sent."""
    walks: PastWalks
    """The walks among these."""
    walk_library: WalkLibrary
    """The same, read."""
    builds: MapBuilds
    """Maps that are built of these."""
    site_imports: SiteImports
    """Sites that come in as archives."""
    exports: Exports
    """Files to download."""
    rehearsals: Rehearsals
    """Ways walked by nobody, to hear what would be said."""
    sounds: Sounds
    """How that sounds."""
    surveys: Surveys
    """What is measured in the map's cloud."""
    checks: MapChecks
    """What is wrong, or may be, with the draft."""
    alerts: Alerts
    """What somebody who watches must notice."""
    alert_store: AlertStore
    """Earlier alerts."""
    incidents: Incidents
    """What was heard of devices around alerts."""
    incident_timelines: IncidentTimelines
    """The same, to be played."""
    access: AccessLog
    """Who has watched, and who has looked at what is kept: ``note`` is called wherever that is shown."""
    watching: Watching
    """Who watches which walker now."""
    late_audit: LateAudit
    """Orders to devices, written down beside whoever gives them."""
    retention: Retention
    """Deletes what is too old."""
    timers: tuple[Repeating, ...]
    """What is done again and again while the console serves."""


def build_services(config: ConsoleConfig, store: Store, model: SiteModel, hub: DeviceHub) -> Services:
    """Put the parts together: sessions that end close their sockets, what is published reaches the devices."""
    sockets, device_sockets, views = SessionSockets(), SessionSockets(), ViewRequests()
    package = MapPackage(config.site_folder, config.data_folder / "package")

    def session_ended(session_id: str) -> None:
        sockets.close(session_id)
        views.forget(session_id)

    def model_changed(change: ModelChange) -> None:
        if change.kind == "publish":
            hub.offer_graph(model.for_devices, package.checksum)

    def commanded(device_id: str, command: Command) -> None:
        # What was said to a walker is theirs; that something was said is not.
        detail = device_id if command.kind == "say" else f"{device_id} {command.detail}"
        late_audit.note(command.who, f"device_{command.kind}", detail)

    def asks_for_colour(device_id: str, command: Command) -> None:
        # Nobody is asked for what cannot be written down.
        access.note(command.who, "colour", device_id)

    def look_who_watches() -> None:
        hub.forget_colours()
        watching.look()

    def look_who_is_signed_in() -> None:
        close_what_is_over(sockets, accounts.over, session_ended)
        close_void_links()
        # Last: it writes, which a full disk refuses.
        accounts.note_used(sockets.session_ids())

    def tell_accesses(device_id: str) -> None:
        for each in (device_id,) if device_id else hub.connected_ids():
            hub.send(each, access.told_to(each))

    late_audit = LateAudit(store)
    auditing = Repeating("audit log", WRITE_EVERY_S, late_audit.write)
    late_audit.on_noted = auditing.wake
    access = AccessLog(store)
    access.on_changed = tell_accesses
    watching = Watching(hub.now_s, access, hub)
    model.subscribe(model_changed)
    hub.on_command, hub.before_colour = commanded, asks_for_colour
    accounts = Accounts(store, hub.now_s, session_ended)
    devices = DeviceStore(store)
    close_void_links = partial(close_what_is_over, device_sockets, devices.void, device_sockets.close)
    settings = SettingsStore(store)
    tuning = Tuning(settings, hub)
    recordings = Recordings(config.data_folder / "recordings", store.wall_s)
    walks = PastWalks(recordings)
    walk_library, what_ifs = WalkLibrary(walks), WhatIfs(walks, config.data_folder / "what-if")

    alert_store = AlertStore(store)
    incidents = Incidents(config.data_folder / "incidents", hub, store.wall_s)
    alerts = Alerts(hub, alert_store, incidents)
    hub.subscribe_forgotten(alerts.forget_device)
    hub.subscribe_forgotten(incidents.forget_device)
    incident_timelines = IncidentTimelines(incidents)

    kept_of_walkers: dict[str, DeleteBefore] = {
        "Walks": _and_then(recordings.delete_before, partial(_forget_deleted_walks, walks, walk_library, what_ifs)),
        "Incidents": _and_then(incidents.delete_before, incident_timelines.forget_deleted),
        "Alerts": alert_store.delete_before,
        "Events": partial(_delete_events_before, devices, hub),
        "Access log": access.delete_before,
        "Orders in the audit log": store.redact_audit_before,
    }
    retention = Retention(store, kept_of_walkers, note=late_audit.note)
    builds = MapBuilds(recordings, config.data_folder / "maps")
    surveys = Surveys(config.site_folder, package.checksum, config.data_folder / "surveys")
    checks = MapChecks(model, surveys, device_settings=partial(_running_settings, tuning, hub))
    return Services(
        config=config,
        store=store,
        accounts=accounts,
        devices=devices,
        model=model,
        hub=hub,
        presence=Presence(hub.now_s),
        views=views,
        sockets=sockets,
        device_sockets=device_sockets,
        close_void_links=close_void_links,
        package=package,
        settings=settings,
        presets=Presets(store),
        tuning=tuning,
        recordings=recordings,
        walks=walks,
        walk_library=walk_library,
        what_ifs=what_ifs,
        builds=builds,
        site_imports=SiteImports(builds.folder),
        exports=Exports(model, config.site_folder, config.data_folder),
        rehearsals=Rehearsals(hub.now_s),
        sounds=Sounds(),
        surveys=surveys,
        checks=checks,
        alerts=alerts,
        alert_store=alert_store,
        incidents=incidents,
        incident_timelines=incident_timelines,
        access=access,
        watching=watching,
        late_audit=late_audit,
        retention=retention,
        timers=(
            auditing,
            Repeating("retention", EVERY_S, retention.run),
            Repeating("watching", LOOK_EVERY_S, look_who_watches),
            Repeating("signed in", LOOK_WHO_IS_SIGNED_IN_EVERY_S, look_who_is_signed_in),
            Repeating("room on the disk", SEE_TO_ROOM_EVERY_S, store.see_to_room),
            Repeating("away devices", EVERY_S, partial(_forget_away, hub, alerts)),
        ),
    )


def _running_settings(tuning: Tuning, hub: DeviceHub) -> list[dict[str, SettingValue]]:
    return [tuning.running_values(device) for device in hub.devices() if device.connected]


def _forget_away(hub: DeviceHub, alerts: Alerts) -> None:
    hub.forget_away(but_for=alerts.concerned_ids())


def _delete_events_before(devices: DeviceStore, hub: DeviceHub, wall_s: float) -> int:
    count = devices.delete_before(wall_s)
    for device in hub.devices() if count else ():
        hub.keep_events(device.device_id, devices.latest_events(device.device_id, EVENTS_KEPT_COUNT))
    return count


def _forget_deleted_walks(walks: PastWalks, library: WalkLibrary, what_ifs: WhatIfs) -> None:
    library.forget_deleted(walks.all())
    what_ifs.forget_deleted()


def _and_then(delete_before: DeleteBefore, forget: Callable[[], None]) -> DeleteBefore:
    """Return what deletes, and has forgotten then what was found in what is gone."""

    def both(wall_s: float) -> int:
        try:
            return delete_before(wall_s)
        finally:
            forget()

    return both
