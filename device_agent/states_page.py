"""The page of the docs on states, made from the table, the buttons and the texts."""

from __future__ import annotations

from device_agent.adapters.keyboard_buttons import KEY_NAMES
from device_agent.menu import ANSWERS, MAIN_LONG, MAIN_SHORT, OTHERS, SET_OFF_WITHIN_S, Meaning
from device_agent.ports import Button, PressKind
from device_agent.states import EVENT_SOURCES, STATES, WISHES, StateAction, StateEvent, Transition
from navcore.cues.texts import TEXTS
from navcore.modes import Mode
from navcore.types import Action


def states_markdown() -> str:
    """Return docs/states.md."""
    lines = [
        "# States",
        "",
        "What the device does, what leads from one state to another, and what the buttons mean; made by `make docs`",
        "from `device_agent/states.py` and `device_agent/menu.py`. The device runs from the same table.",
        "",
        *_states(),
        *_drawing(),
        *_events(),
        *_table(),
        *_refusals(),
        *_actions(),
        *_buttons(),
        *_laws(),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _states() -> list[str]:
    lines = [
        "## The states",
        "",
        "| state | at the console | what it means | may be told |",
        "| --- | --- | --- | --- |",
    ]
    for mode in Mode:
        told = ", ".join(action.value for action in Action if action in STATES[mode].allows)
        lines.append(f"| `{mode.value}` | {mode.label} | {mode.sentence} | {told} |")
    return [*lines, ""]


def _drawing() -> list[str]:
    lines = [
        "## The drawing",
        "",
        "Only what changes the state. A fault leads back to the state that it came from; meanwhile that state answers",
        "what people ask, and may change beneath the fault.",
        "",
        "```mermaid",
        "stateDiagram-v2",
        f"    [*] --> {Mode.LOCALIZING.value}",
    ]
    for mode in Mode:
        arrows: dict[Mode, list[str]] = {}
        for event, transition in STATES[mode].answers.items():
            if transition.to not in (None, mode):
                assert transition.to is not None
                arrows.setdefault(transition.to, []).append(event.value)
        for to, events in sorted(arrows.items()):
            lines.append(f"    {mode.value} --> {to.value}: {', '.join(events)}")
        if any(transition.back for transition in STATES[mode].answers.values()):
            lines.append(f"    {mode.value} --> before: {StateEvent.RECOVERED.value}")
    return [*lines, "    before: the state before the fault", "```", ""]


def _events() -> list[str]:
    lines = ["## The events", "", "| event | caused by |", "| --- | --- |"]
    lines += [f"| {event.value} | {EVENT_SOURCES[event]} |" for event in StateEvent]
    return [*lines, ""]


def _table() -> list[str]:
    names = _refusal_letters()
    lines = [
        "## The table",
        "",
        "→ the next state; · stays; a number is an action, a letter a refusal, both below; ↓ answered as in the state",
        "before the fault; ↑ back to that state.",
        "",
        f"| event | {' | '.join(mode.value for mode in Mode)} |",
        f"| {' | '.join(['---'] * (len(Mode) + 1))} |",
    ]
    for event in StateEvent:
        cells = [_cell(mode, STATES[mode].answers[event], names) for mode in Mode]
        lines.append(f"| {event.value} | {' | '.join(cells)} |")
    return [*lines, ""]


def _cell(mode: Mode, transition: Transition, letters: dict[str, str]) -> str:
    if transition.refused:
        return letters[transition.says]
    if transition.beneath or transition.back:
        return "↓" if transition.beneath else "↑"
    where = "·" if transition.to in (None, mode) else f"→ {transition.to.value}"
    number = _numbers().get(transition.action)
    return where if number is None else f"{where} {number}"


def _refusal_letters() -> dict[str, str]:
    keys: list[str] = []
    for event in StateEvent:
        for mode in Mode:
            transition = STATES[mode].answers[event]
            if transition.refused and transition.says not in keys:
                keys.append(transition.says)
    return {key: chr(ord("a") + index) for index, key in enumerate(keys)}


def _refusals() -> list[str]:
    lines = ["## Refusals", "", "Every one is spoken.", "", "| | English | 中文 |", "| --- | --- | --- |"]
    lines += [f"| {letter} | {TEXTS['en'][key]} | {TEXTS['zh'][key]} |" for key, letter in _refusal_letters().items()]
    return [*lines, ""]


def _numbers() -> dict[StateAction, int]:
    return {action: number for number, action in enumerate(StateAction) if action is not StateAction.NOTHING}


def _actions() -> list[str]:
    lines = ["## Actions", "", "| | what is done |", "| --- | --- |"]
    lines += [f"| {number} | {action.value[0].upper()}{action.value[1:]}. |" for action, number in _numbers().items()]
    return [*lines, ""]


def _buttons() -> list[str]:
    lines = [
        "## The buttons",
        "",
        "Everything can be done with them, without a console; every press is answered in words. While the places are",
        "browsed, the main button chooses the one that was named last: its name and the length of the way are said,",
        f"and a second press within {SET_OFF_WITHIN_S:.0f} s sets off. Held, it closes the list, and stops who is led.",
        "The list closes by itself half a minute after the last press. An answer is cut off by stops, turns and",
        "steering: whoever stands hears it out.",
        "",
        "| in every state | short | held |",
        "| --- | --- | --- |",
        *(_row(button) for button in Button if button is not Button.MAIN),
        "",
        "| state | main | main, held |",
        "| --- | --- | --- |",
    ]
    lines += [f"| {mode.value} | {_meaning(MAIN_SHORT[mode])} | {_meaning(MAIN_LONG[mode])} |" for mode in MAIN_SHORT]
    lines += [
        "",
        "Holding *next* lists the places by name, and again by distance. After the last place comes *privacy*, which",
        "the main button opens: who watches, who has looked, and what the console gets; there it does what was named",
        "last.",
        "Where no place can be chosen (off duty, while a map is recorded), holding *next* opens that list.",
        "",
        f"While somebody at the console asks to see colour pictures, {_answer_keys(True)} allows it for a minute, and",
        f"{_answer_keys(False)} refuses it; while they see them, {_answer_keys(False)} ends it",
        "([privacy.md](privacy.md)).",
        "",
        "Off duty, *main* held asks whether a sighted person wants to record a map; *next* within half a minute begins",
        f"the [map walk](map_walk.md), and any other press does not. In `{Mode.MAPPING.value}` nobody is led.",
        "",
        "In a fault, they mean what they mean in the state before it. In `vbr demo`, and with `--buttons keyboard`:",
        "",
        "| key | button |",
        "| --- | --- |",
        *(f"| {keys} | {button} |" for keys, button in KEY_NAMES),
        "",
    ]
    return lines


def _answer_keys(allowed: bool) -> str:
    return " or ".join(f"*{button.value}* held" for (button, _), meaning in ANSWERS.items() if meaning is allowed)


def _row(button: Button) -> str:
    meanings = (_meaning(OTHERS[button, kind]) for kind in PressKind)
    return f"| {button.value} | {' | '.join(meanings)} |"


def _meaning(meaning: Meaning) -> str:
    return meaning.value if isinstance(meaning, StateEvent) else meaning


def _laws() -> list[str]:
    findings = ", ".join(event.value for event in StateEvent if event not in WISHES)
    return [
        "## What holds always",
        "",
        "- *Walk* is told in `guiding` alone. Guidance is checked against the table once more before it is spoken.",
        "- *Stop* leads from every state to one in which the walker stands, or is refused in one.",
        "- Every event is answered in every state. What the device finds is never refused",
        f"  ({findings}).",
        "- A refusal is spoken, and the console hears of it.",
        "- Walker and console may give orders at the same time: the last one holds, and both hear of it.",
        "",
    ]
