"""The settings page of the docs, made from the settings model."""

from __future__ import annotations

from navcore.settings import ORDERS, SettingSpec, setting_specs


def settings_markdown() -> str:
    """Return docs/settings.md."""
    lines = [
        "# Settings",
        "",
        "Made by `make docs` from `navcore/settings.py`. Change one for a run with `--set group.name=value`, or live",
        "in the console. Settings marked ⚠ are critical to safety: changed live they need a confirmation, run for a",
        "while only unless somebody keeps them, and are locked while somebody is led.",
    ]
    group = ""
    for spec in setting_specs():
        if spec.group != group:
            group = spec.group
            lines += [
                "",
                f"## {spec.group_title} (`{group}`)",
                "",
                "| setting | default | range | meaning | source |",
                "| --- | --- | --- | --- | --- |",
            ]
        lines.append(_row(spec))
    lines += ["", "## What must stay in order", "", "| setting | | setting | because |", "| --- | --- | --- | --- |"]
    for order in ORDERS:
        relation = "≤" if order.may_equal else "<"
        lines.append(f"| `{order.lower}` | {relation} | `{order.upper}` | {order.why} |")
    return "\n".join(lines) + "\n"


def _row(spec: SettingSpec) -> str:
    unit = f" {spec.unit}" if spec.unit else ""
    choices = ("true", "false") if spec.kind == "bool" else spec.choices
    span = ", ".join(choices) if spec.low is None else f"{spec.low:g} – {spec.high:g}{unit}"
    warning = " ⚠" if spec.safety else ""
    return f"| `{spec.name}`{warning} | {_default(spec, unit)} | {span} | {spec.meaning} | {spec.source} |"


def _default(spec: SettingSpec, unit: str) -> str:
    if isinstance(spec.default, bool):
        return "true" if spec.default else "false"
    return spec.default if isinstance(spec.default, str) else f"{spec.default:g}{unit}"
