"""What axe finds wrong with a page, in both themes: WCAG 2.2 A and AA."""

from __future__ import annotations

from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

ALL_RULES = {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]}
COLOUR_RULES = {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}
"""Themes differ in colours alone (a test says so): a second one needs no other rules."""


def faults(page: Page, rules: dict[str, Any] = ALL_RULES) -> list[str]:
    """Return each fault, with where it is and what to do."""
    if not page.evaluate("() => 'axe' in window"):
        page.evaluate(Axe().axe_script)
    # What lies in the frame is viser's own page.
    options = {"runOnly": rules, "resultTypes": ["violations"], "iframes": False}
    asked = [{"exclude": [["iframe"]]}, options]
    found = page.evaluate("async (asked) => (await axe.run(...asked)).violations", asked)
    return [
        f"{fault['id']}: {node['html'][:160]} {node['failureSummary']}" for fault in found for node in fault["nodes"]
    ]


def in_both_themes(page: Page, what: str) -> list[str]:
    """Return the faults of the page as it is now, light and dark."""
    found = []
    for theme, rules in (("light", ALL_RULES), ("dark", COLOUR_RULES)):
        page.emulate_media(color_scheme=theme, reduced_motion="reduce")
        found += [f"{what}, {theme}: {fault}" for fault in faults(page, rules)]
    return found
