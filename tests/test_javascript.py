"""The pages' modules fit together: what is imported is exported, what is used is declared, and nothing is left over."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import pytest
from javascript_modules import Module
from javascript_modules import read as read_anew

read = functools.cache(read_anew)

STATIC = Path(__file__).parent.parent / "static"
MODULES = {path.name: path.read_text(encoding="utf-8") for path in sorted(STATIC.glob("*.js"))}
PAGES = {path.name: path.read_text(encoding="utf-8") for path in sorted(STATIC.glob("*.html"))}
SCRIPT = re.compile(r'<script[^>]* src="/static/([^"]+)"')
USED = (
    "Array AudioContext Blob Boolean CSS Date Error GainNode Image Infinity Intl JSON Map Math NaN Number Object"
    " OscillatorNode Promise ResizeObserver Set SpeechSynthesisUtterance String Symbol URL URLSearchParams Uint8Array"
    " WebSocket XMLHttpRequest addEventListener clearInterval clearTimeout crypto document encodeURIComponent fetch"
    " globalThis history localStorage location matchMedia navigator performance removeEventListener"
    " requestAnimationFrame sessionStorage setInterval setTimeout speechSynthesis undefined"
)
OF_THE_BROWSER = frozenset(USED.split())
"""What the modules use of the browser: whoever uses more of it adds it here."""


def faults(sources: dict[str, str], pages: dict[str, str]) -> list[str]:
    """Return what does not fit together, one sentence each."""
    modules = {name: read(source) for name, source in sources.items()}
    found = [
        f"{page} loads {name}, which is not there" for page, html in pages.items()
        for name in SCRIPT.findall(html) if name not in modules
    ]  # fmt: skip
    for name, module in modules.items():
        found += [f"{name} uses {each}, which nothing declares" for each in module.undeclared - OF_THE_BROWSER]
        found += [f"{name} declares or imports {each}, and does not use it" for each in module.unused]
        for source, wanted in module.imports.items():
            exported = modules[source[2:]].exports if source[2:] in modules else None
            found += [f"{name} imports {source}, which is not there"] if exported is None else []
            found += [
                f"{name} imports {each}, which {source} does not export" for each in set(wanted) - (exported or set())
            ]
    return sorted(found + _left_over(modules, pages))


def _left_over(modules: dict[str, Module], pages: dict[str, str]) -> list[str]:
    """Return the modules that no page loads, and the exports that nobody imports."""
    loaded, waiting = set[str](), [name for html in pages.values() for name in SCRIPT.findall(html) if name in modules]
    while waiting:
        name = waiting.pop()
        loaded.add(name)
        waiting += [each for each in _imported(modules[name]) if each in modules and each not in loaded]
    of_tests = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_browser*.py"))
    found = [f"no page loads {name}" for name in modules.keys() - loaded]
    for name, module in modules.items():
        wanted = {each for other in modules.values() for each in other.imports.get(f"./{name}", ())}
        left = {each for each in module.exports - wanted if not re.search(rf"\b{re.escape(each)}\b", of_tests)}
        found += [f"{name} exports {each}, which nobody imports" for each in left]
    return found


def _imported(module: Module) -> list[str]:
    return [source[2:] for source in module.imports]


def test_all_modules_of_the_pages_fit_together() -> None:
    assert len(MODULES) > 60
    assert faults(MODULES, PAGES) == []
    used = {each for source in MODULES.values() for each in read(source).undeclared}
    assert used == OF_THE_BROWSER, "nothing is allowed that nobody uses"


PLANTED = (
    ("live.js", "const SILENT_AFTER_S = 3;", "", "live.js uses SILENT_AFTER_S, which nothing declares"),
    ("live.js", "export function isPast", "function isPast",
     "walker.js imports isPast, which ./live.js does not export"),
    ("walker.js", 'import { isPast } from "./live.js";', "", "walker.js uses isPast, which nothing declares"),
    ("actions.js", "const { id } = this.device;", "", "actions.js uses id, which nothing declares"),
    ("sentences.js", "for (const chip of", "for (const other of", "sentences.js uses chip, which nothing declares"),
    ("dialog.js", "./progress.js", "./gone.js", "dialog.js imports ./gone.js, which is not there"),
    ("dialog.js", "import", "export const LEFT = 1; import", "dialog.js exports LEFT, which nobody imports"),
    ("dialog.js", "import", "const left = 1; import", "dialog.js declares or imports left, and does not use it"),
    ("dialog.js", "{ asked }", "{ asked, told }", "dialog.js imports told, which ./progress.js does not export"),
)  # fmt: skip


@pytest.mark.parametrize(("name", "before", "after", "fault"), PLANTED, ids=[fault for *_, fault in PLANTED])
def test_what_a_merge_may_lose_or_leave_behind_is_found(name: str, before: str, after: str, fault: str) -> None:
    assert before in MODULES[name]
    assert fault in faults(MODULES | {name: MODULES[name].replace(before, after, 1)}, PAGES)


def test_a_script_of_a_page_and_a_page_of_a_script_are_missed() -> None:
    without = {name: source for name, source in MODULES.items() if name != "overview.js"}
    assert "overview.html loads overview.js, which is not there" in faults(without, PAGES)
    assert "no page loads alone.js" in faults(MODULES | {"alone.js": "setTimeout(() => undefined);"}, PAGES)


FORMS = r"""
import { a } from "./a.js";
export class Part {
  static of({ b: [c, , ...d], e = c, [a]: f }, ...rest) { return [c, d, e, f, rest]; }
  get g() { return this.#h; } #h = 1;
}
export async function later(x = a, { y } = {}) { for await (const each of x) if (each) y(each); else x(each); }
export const k = (x) => ({ x, z: x ? a : k, [a]: `${x.map((m) => `${m} \` + "`")} ${a}` }),
  l = async ({ n }) => n / 2 / k;
for (let s = 0, t = s; s < t; s++) k(/[/"'`]\/{/u.test(s));  // a comment's "quote
try { k(a?.b); } catch ({ message }) { k(message, a ?.5 : 1); } finally { k(); }
"""


def test_no_form_of_the_language_that_is_used_here_is_taken_for_a_fault() -> None:
    module = read(FORMS)
    assert (module.undeclared, module.unused) == (frozenset(), frozenset())
    assert module.exports == {"Part", "later", "k", "l"}
    for outside in ("each;", "s;", "message;", "function q() { const v = 1; { const w = v; } return w; } q();"):
        assert read(FORMS + outside).undeclared, f"{outside} is known only elsewhere"
