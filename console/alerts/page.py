"""The alerts' page of the docs, made from the table of rules."""

from __future__ import annotations

from console.alerts.alerts import SHELF_MINUTES
from console.alerts.incidents import AFTER_S, BEFORE_S, LONGEST_S
from console.alerts.rules import RULES, Priority, Quantity, Rule

_BEFORE = """# Alerts

Made by `make docs` from the table in `console/alerts/rules.py`.

The console looks at every device four times a second. An alert asks whoever watches for something; it is text,
colour, shape and sound, and the same for everybody: what one person acknowledges is acknowledged for all. Guidance
knows nothing of alerts; the device stops the walker by itself, with or without a console.
"""


def alerts_markdown() -> str:
    """Return docs/alerts.md."""
    minutes = f"{', '.join(map(str, SHELF_MINUTES[:-1]))} or {SHELF_MINUTES[-1]}"
    lines = [
        _BEFORE,
        "| alert | priority | it holds while | raised at | ends at | raised after | returns after | goes up after |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *map(_row, RULES.values()),
        "",
        "*Raised after*: the condition must hold so long before anybody is told. *Returns after*: it must be *known* to"
        " be over for so long. Between *raised at* and *ends at* lies a deadband: what trembles about a limit is told"
        " once. *Goes up after*: unacknowledged for so long, the priority goes up one step.",
        "",
        "## What is said",
        "",
        *(line for rule in RULES.values() for line in _words(rule)),
        "",
        "## Priorities",
        "",
        "| priority | what it asks for | sound, once it is switched on |",
        "| --- | --- | --- |",
        "| ▲ high | act now: somebody may be in danger, or nothing is known of them | five quick tones, every 10 s"
        " until it is acknowledged |",
        "| ■ medium | act within minutes | three tones, every 30 s until it is acknowledged |",
        "| ● low | know it; act within the walk | one tone |",
        "",
        "## The life of an alert (ISA-18.2, IEC 62682)",
        "",
        "- *Unacknowledged*: its condition holds. *Acknowledged*: somebody has seen it, and it still holds. *Returned*:"
        " it is over, and nobody has seen it: it stays until somebody acknowledges it. Nothing else ends an alert.",
        "- Where the condition comes back before that, it is the same alert, counted up.",
        f"- *Shelved*: it keeps silent for {minutes} minutes, with a reason. Then, or when it is taken off the shelf,"
        " it is unacknowledged again if its condition still holds.",
        "- What is stale or unknown raises nothing but *nothing heard while leading*, and ends nothing. A console that"
        " is started anew takes up every alert, and knows who was being led.",
        "- A device that led somebody and has gone is missed, over restarts of the console, until it is heard of again,"
        " its token is void, or somebody who may give it orders ends the watch and says why.",
        "- What is judged is shown at once; it is written down by a thread of its own, again and again where the disk"
        " takes nothing.",
        "- The list is sorted by priority, then what nobody has seen, then the newest: a flood does not bury the"
        " worst.",
        "- Every step is kept, with who and when; what a person does is on the disk before it is answered.",
        "",
        "## Incidents",
        "",
        f"When an alert of high priority is raised or comes again, or a person presses *Keep the last {BEFORE_S:g} s*,"
        f" what the device sent from {BEFORE_S:g} s before to {AFTER_S:g} s after is kept in the console's data folder"
        f" (`incidents/`); what happens meanwhile belongs to it, up to {LONGEST_S:g} s in all. It is written as it"
        " comes, so a crash keeps what there was. It holds states, events, the route, the running settings and depth"
        " silhouettes; no picture in colours. It can be downloaded as a zip that needs no program of ours; an admin"
        " deletes it. One that cannot be kept is tried again while its alert lasts.",
    ]
    return "\n".join(lines).rstrip() + "\n"


def _row(rule: Rule) -> str:
    escalation = f"{rule.escalate_after_s:g} s" if rule.escalate_after_s is not None else "–"
    raised = ", or ".join(f"{q.name} {_limit(q, q.raise_at)}" for q in rule.quantities) or "–"
    ends = ", and ".join(f"{q.name} {_other(q)}" for q in rule.quantities) or "–"
    return (
        f"| {rule.title} | {_mark(rule.priority)} {rule.priority.word} | {rule.when_words} | {raised} | {ends} |"
        f" {rule.on_delay_s:g} s | {rule.off_delay_s:g} s | {escalation} |"
    )


def _limit(quantity: Quantity, value: float) -> str:
    return f"{quantity.side} {value:g} {quantity.unit}"


def _other(quantity: Quantity) -> str:
    side = "<" if quantity.side == "≥" else ">"
    return f"{side} {quantity.clear_at:g} {quantity.unit}"


def _mark(priority: Priority) -> str:
    return {Priority.HIGH: "▲", Priority.MEDIUM: "■", Priority.LOW: "●"}[priority]


def _words(rule: Rule) -> list[str]:
    sentence = rule.sentence.format(name="*NAME*", what="*WHAT*", value="*FIGURE*", reason="*REASON*")
    return [f"- **{rule.title}.** “{sentence}” {rule.advice}"]
