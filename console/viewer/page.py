"""The page that carries the scene: viser's client, with our own script, under a strict Content-Security-Policy.

The client is a single HTML file with a single inline script. It would connect to, and run code from, any address given
in its query (``?websocket=``, ``?playbackPath=``); :func:`console.viewer.mount.plain_query` takes both out of it, and
``connect-src 'self'`` would end both but for what the query itself holds.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from dataclasses import dataclass
from html.parser import HTMLParser

THEME_COOKIE = "vbr-theme"
"""Says whether this browser asks for a light theme: the scene's socket can carry nothing else."""
_WATCH_SCRIPT = """
document.hasFocus = () => document.visibilityState === 'visible';
(() => {
  const signIn = %(sign_in)s, session = %(session)s;
  const look = async () => {
    if (document.visibilityState !== 'visible') return;
    try {
      const answer = await fetch(session, {cache: 'no-store', credentials: 'same-origin'});
      if (answer.status === 401 || answer.status === 403) (window.top || window).location.assign(signIn);
    } catch (error) { /* The console is away: viser keeps trying to reconnect by itself. */ }
  };
  setInterval(look, 5000);
})();
(() => {
  const light = matchMedia('(prefers-color-scheme: light)');
  const keep = () => {
    document.cookie = '%(theme_cookie)s=' + (light.matches ? 'light' : 'dark') + '; path=/; SameSite=Strict';
  };
  keep();
  light.addEventListener('change', keep);
})();
(() => {
  // Shortcuts are deaf while somebody types: Enter and Escape in a text field leave it, and then count.
  const SEND_MS = 150;
  const field = (target) => target.matches?.('input:not([type]), input[type=text]') && !target.readOnly
    && !target.closest('[role=dialog], [role=combobox]') && !['numeric', 'decimal'].includes(target.inputMode);
  document.addEventListener('keydown', (event) => {
    if ((event.key !== 'Enter' && event.key !== 'Escape') || event.isComposing || !field(event.target)) return;
    event.target.blur();
    // The last letters are still on their way to the console.
    const again = new KeyboardEvent('keydown', {key: event.key, code: event.key, bubbles: true});
    setTimeout(() => document.body.dispatchEvent(again), SEND_MS);
  }, true);
  // A place that has just been begun wants its name: letters typed now are no shortcuts.
  const visible = (element) => element.getClientRects().length > 0;
  let wasBegun = false;
  setInterval(() => {
    const title = document.evaluate("//*[text()='New place']", document.body, null, 9, null).singleNodeValue;
    const isBegun = Boolean(title && visible(title));
    if (isBegun && !wasBegun) {
      const after = (input) => title.compareDocumentPosition(input) & Node.DOCUMENT_POSITION_FOLLOWING;
      [...document.querySelectorAll('input')].find((input) => field(input) && visible(input) && after(input))?.focus();
    }
    wasBegun = isBegun;
  }, 100);
  // Plain arrows and Space are the editor's; the camera, which knows keys by their code, has Alt with the arrows.
  const OURS = {'?': 'h', ArrowUp: 'ArrowUp', ArrowDown: 'ArrowDown', ArrowLeft: 'ArrowLeft', ArrowRight: 'ArrowRight'};
  const busy = (target) => target.closest?.('input, textarea, select, [contenteditable], [role=tablist], [role=dialog],'
    + ' [role=combobox], [role=listbox], [role=slider], [role=menu]');
  document.addEventListener('keydown', (event) => {
    const key = OURS[event.key];
    if (!event.isTrusted || !key || busy(event.target)) return;
    event.preventDefault();
    if (event.altKey) return;
    event.stopImmediatePropagation();
    const shiftKey = event.shiftKey && event.key !== '?';
    document.body.dispatchEvent(new KeyboardEvent('keydown',
      {key, code: '', bubbles: true, shiftKey, ctrlKey: event.ctrlKey, metaKey: event.metaKey, repeat: event.repeat}));
  }, true);
})();
"""

_STYLE = '.mantine-Notifications-root[data-position^="top"] { top: 58px !important }'
"""What viser tells stands below the buttons that our page lays over the scene, not under them."""


@dataclass(frozen=True, slots=True)
class ScenePage:
    """The page, ready to be served."""

    body: bytes
    body_gzip: bytes
    etag: str
    content_security_policy: str


def scene_page(client_html: str, title: str, session_url: str, sign_in_url: str) -> ScenePage:
    """Make the page from viser's client.

    ``session_url`` answers 401 once the session is over; then the browser goes to ``sign_in_url``. The injected script
    also lets viser reconnect while the page is visible without the focus (a wall monitor, a frame in our page), gives
    the arrows to the editor, and tells the theme that this browser asks for.
    Raises ValueError where the client no longer has the form that this relies on.
    """
    scripts = inline_scripts(client_html)
    if len(scripts) != 1 or client_html.count("<head>") != 1 or client_html.count("<title>Viser</title>") != 1:
        raise ValueError("viser's client page has another form than in 1.1.1: keep viser==1.1.1.")
    ours = _WATCH_SCRIPT % {
        "sign_in": json.dumps(sign_in_url), "session": json.dumps(session_url), "theme_cookie": THEME_COOKIE,
    }  # fmt: skip
    body = client_html.replace("<title>Viser</title>", f"<title>{title}</title>")
    body = body.replace("<head>", f"<head><script>{ours}</script><style>{_STYLE}</style>", 1)
    data = body.encode()
    return ScenePage(
        data, gzip.compress(data, 6, mtime=0), f'"{hashlib.sha256(data).hexdigest()[:32]}"', _policy([scripts[0], ours])
    )


def inline_scripts(html: str) -> list[str]:
    """Return the text of every inline script of a page."""
    reader = _ScriptReader()
    reader.feed(html)
    return reader.scripts


def _policy(scripts: list[str]) -> str:
    """Return the policy. It refuses ``eval``, so a browser's log has one EvalError of each scene that is opened.

    That is viser's sorter of Gaussian splats (Sorter.wasm, whose glue makes functions of strings): its client makes it
    ready whether or not there are any. Nothing here draws splats, and no switch of viser's leaves it out.
    """
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    return (
        f"default-src 'none'; script-src {hashes} 'strict-dynamic' 'wasm-unsafe-eval'; worker-src blob:; "
        "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; connect-src 'self' data: blob:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
    )


class _ScriptReader(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=False)
        self.scripts: list[str] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag == "script"
        if self._inside:
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.scripts[-1] += data
