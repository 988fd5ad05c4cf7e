"""The walker's part of the panel: how they are, what was decided and why, where to guide them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import viser

from console.errors import ForbiddenError
from console.hub import DeviceHub
from console.live import Freshness, LiveDevice
from console.live_panel import reason_sentence
from console.roles import EDITING, SignedIn
from console.viewer.appearance import age_text
from console.viewer.live_view import LiveView, direction_words
from console.viewer.question import Question
from console.viewer.widgets import at_once, on_change, on_choice, on_press, set_value
from console.viewer.wording import status_card
from navcore.errors import VbrError
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import WalkerState

Tell = Callable[[str, str], None]
_NOWHERE = "– choose –"
_GUIDANCE_TELLS = (Mode.GUIDING, Mode.LOST, Mode.FAULT)
"""States in which guidance's own words say more than the state."""


class WalkerPanel:
    """Widgets about one device for one client."""

    def __init__(self, client: viser.ClientHandle, hub: DeviceHub, person: SignedIn, tell: Tell) -> None:
        self._hub = hub
        self._person = person
        self._tell = tell
        self.device_id: str | None = None
        self._names: dict[str, str] = {}
        self._poi_ids: dict[str, str] = {}
        self._graph = PoiGraph()
        gui = client.gui
        self.question = Question(gui)
        """What is asked before somebody who is on their way is led elsewhere, or no more."""
        self._devices = gui.add_dropdown("Walker", (_NOWHERE,), visible=False)
        self._status = gui.add_html("")
        self._may_guide = person.role in EDITING
        self._target = gui.add_dropdown("Guide to", (_NOWHERE,), visible=self._may_guide)
        self._guide = gui.add_button("Guide the walker there", icon=viser.Icon.NAVIGATION, visible=self._may_guide)
        self._pause = gui.add_button_group("Guidance", ("Pause", "Resume", "Stop", "Repeat"), visible=self._may_guide)
        on_change(self._devices, self._choose_device, at_once)
        on_press(self._guide, self._guide_there, at_once)
        who = person.user_name
        orders = {"Pause": hub.pause, "Resume": hub.resume, "Repeat": hub.repeat}
        choices: dict[str, Callable[[], object]] = {
            word: partial(self._command, partial(_ordered, order, who)) for word, order in orders.items()
        }
        on_choice(self._pause, choices | {"Stop": self._stop_guiding}, at_once)

    def _choose_device(self) -> None:
        self.device_id = next((key for key, name in self._names.items() if name == self._devices.value), None)

    def _guide_there(self) -> None:
        poi_id = self._poi_ids.get(self._target.value)
        if poi_id is None:
            self._tell("No destination", "Choose a place first.")
        else:
            self.guide_to(poi_id)

    def guide_to(self, poi_id: str) -> None:
        """Ask the device to lead the walker to a place; whoever is on their way elsewhere is not by one click."""
        device = self._led_device()
        guide = partial(self._command, lambda at: self._hub.set_destination(at, poi_id, self._person.user_name))
        if device is None or device.state is None or device.state.destination_id in (None, poi_id):
            return guide()
        there, before, by = self._name(poi_id), self._name(device.state.destination_id), device.state.destination_by
        whose = f"{by} has chosen that." if by else f"{device.name} has chosen that themselves."
        return self.question.ask(
            f"Lead {device.name} elsewhere?",
            f"{device.name} is on the way to {before}. {whose} The walker hears who leads them, and can refuse.",
            yes=f"Guide to {there}", no=f"Keep {before}", action=partial(guide, device.device_id),
        )  # fmt: skip

    def _stop_guiding(self) -> None:
        device = self._led_device()
        stop = partial(self._command, lambda at: self._hub.clear(at, self._person.user_name))
        if device is None or device.state is None:
            return stop()
        where = f" to {self._name(device.state.destination_id)}" if device.state.destination_id else ""
        return self.question.ask(
            "Stop guiding?",
            f"{device.name} is on the way{where}. The walker is told that guidance has ended, and stands without it.",
            yes="Stop guiding", no="Go on guiding", action=partial(stop, device.device_id),
        )  # fmt: skip

    def _led_device(self) -> LiveDevice | None:
        """Return the device that is shown, where this person may guide its walker and somebody is led just now."""
        device = next((each for each in self._hub.devices() if each.device_id == self.device_id), None)
        return device if device is not None and device.leads_somebody and self._may_guide else None

    def _name(self, poi_id: str | None) -> str:
        poi = self._graph.pois.get(poi_id or "")
        return poi.name if poi is not None else poi_id or "nowhere"

    def _command(self, order: Callable[[str], object], device_id: str | None = None) -> None:
        """Give an order to a device, by default to the one that is shown, and say why where it cannot be given."""
        try:
            if not self._may_guide:
                raise ForbiddenError("Your role may watch the walker, and not guide them: ask an editor.")
            order(device_id or self.device_id or "")
        except VbrError as error:
            self._tell("Not sent", str(error))

    def show(self, view: LiveView, devices: tuple[LiveDevice, ...], graph: PoiGraph) -> None:
        """Bring the widgets in line with what is known now."""
        self._show_devices(devices)
        self._show_places(graph)
        is_there = any(device.device_id == self.device_id for device in devices)
        self._status.content = status(view, graph, is_there=is_there)
        idle = view.device is None or not view.device.connected
        self._guide.disabled = idle

    def _show_devices(self, devices: tuple[LiveDevice, ...]) -> None:
        names = {device.device_id: device.name for device in devices}
        if len(set(names.values())) < len(names):
            names = {device.device_id: f"{device.name} ({device.device_id})" for device in devices}
        if names == self._names:
            return
        self._names = names
        if self.device_id not in names:
            self.device_id = next(iter(names), None)
        self._devices.options = tuple(names.values()) or (_NOWHERE,)
        self._devices.visible = len(names) > 1
        if self.device_id is not None:
            set_value(self._devices, names[self.device_id])

    def choose(self, device_id: str) -> None:
        """Show this device from now on."""
        self.device_id = device_id
        if device_id in self._names:
            set_value(self._devices, self._names[device_id])

    def _show_places(self, graph: PoiGraph) -> None:
        self._graph = graph
        poi_ids = {poi.name: poi.id for poi in sorted(graph.pois.values(), key=lambda poi: poi.name) if poi.on_road}
        if poi_ids == self._poi_ids:
            return
        chosen = self._poi_ids.get(self._target.value)
        self._poi_ids = poi_ids
        self._target.options = (_NOWHERE, *poi_ids)
        set_value(self._target, next((name for name, poi_id in poi_ids.items() if poi_id == chosen), _NOWHERE))


def status(view: LiveView, graph: PoiGraph, *, is_there: bool) -> str:
    """Return how the walker is, as HTML; of a device that ``is_there`` nothing is shown before it knows who watches."""
    device, state = view.device, view.state
    if is_there and (device is None or not device.has_told(view.now_s)):
        return status_card("…", "Not told yet.", ())
    if device is None:
        return status_card("lost", "No device has connected yet.", ())
    if state is None:
        return status_card("lost", f"{device.name} has sent no position yet.", ())
    rows = [("Seen", age_text(view.age_s or 0.0) if view.freshness is not Freshness.LIVE else "now")]
    rows += _state_rows(state, graph)
    if device.commands and device.commands[-1].state != "running":
        last = device.commands[-1]
        rows.append(("Last order", f"{last.kind.replace('_', ' ')}: {last.refusal or last.state}"))
    return status_card(view.freshness.value, _heading(state), rows)


def _heading(state: WalkerState) -> str:
    if state.mode not in _GUIDANCE_TELLS:
        return state.mode.label
    if state.action == "stop":
        return f"Stop. {reason_sentence(state.reason)}"
    where = direction_words(state.direction_rad) if state.direction_rad is not None else ""
    return f"{'Walk' if state.action == 'walk' else 'Turn'} {where}"


def _state_rows(state: WalkerState, graph: PoiGraph) -> list[tuple[str, str]]:
    quality = {"localized": "sure", "uncertain": "uncertain", "lost": "LOST"}[state.quality]
    place = f" (± {state.position_std_m * 100:.0f} cm)" if state.position_std_m is not None else ""
    target = graph.pois.get(state.destination_id or "")
    rows = [("State", state.mode.label), ("Position", quality + place)]
    if target is not None:
        left = f", {state.remaining_m:.1f} m to go" if state.remaining_m is not None else ""
        rows.append(("Going to", target.name + left))
    if state.deviation_m is not None:
        rows.append(("Off the route by", f"{state.deviation_m:.2f} m"))
    if state.last_cue:
        rows.append(("Last heard", f"“{state.last_cue}”"))
    rows.append(("Cycle", f"{state.cycle_ms:.0f} ms, {state.frame_rate_hz:.0f} Hz"))
    rows += _load_rows(state)
    return rows


def _load_rows(state: WalkerState) -> list[tuple[str, str]]:
    whole = next((each for each in state.stages if each.stage == "capture_to_cue"), None)
    rows = []
    if whole is not None:
        late = f", {whole.missed_count} late" if whole.missed_count else ""
        rows.append(("Picture to cue", f"{whole.p50_ms:.0f} ms, 99 %: {whole.p99_ms:.0f} ms{late}"))
    if state.load_level != "full":
        rows.append(("Too slow", f"{state.load_level.replace('_', ' ')} in localization"))
    return rows


def _ordered(order: Callable[[str, str], object], who: str, device_id: str) -> object:
    return order(device_id, who)
