/* The stream of what happens: reconnects by itself, and keeps honest about how old things are. */

import { signInAgain } from "./api.js";
import { $, el, setText } from "./dom.js";
import { toast } from "./toast.js";

const RETRY_MS = [500, 1000, 2000, 4000];
const SILENT_AFTER_S = 3;
const SAY_EVERY_MS = 3000;
const TICK_MS = 250;
const SIGNED_OUT = 4401;

/**
 * Call `show(data, elapsed_s, linked)` at each message and four times a second in between. `elapsed_s` is how long ago
 * the message came: add it to every age. `linked` is false once the console has gone silent.
 *
 * `watching` returns the ids of the devices whose walkers the page shows now. Of these it is sent everything, and the
 * walkers are told who watches; nobody watches by a page that cannot be seen.
 */
export function follow(show, watching = () => []) {
  let data = null;
  let receivedAt = 0;
  let failures = 0;
  let socket = null;
  let said = "";
  let saidAt = 0;

  const connect = () => {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    socket = new WebSocket(`${scheme}://${location.host}/live?says=1`);
    said = "";
    let opened = false;
    socket.onopen = () => { opened = true; failures = 0; };
    socket.onmessage = (event) => {
      data = JSON.parse(event.data);
      receivedAt = performance.now();
      draw();
    };
    socket.onclose = async (event) => {
      if (event.code === SIGNED_OUT) return signInAgain();
      if (!opened && (await isSignedOut())) return signInAgain();
      setTimeout(connect, RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)]);
    };
  };
  const draw = () => {
    if (data === null) return;
    const elapsed_s = (performance.now() - receivedAt) / 1000;
    const linked = elapsed_s < SILENT_AFTER_S;
    showLink(linked, elapsed_s);
    show(data, elapsed_s, linked);
    say();
  };
  const say = () => {
    if (socket.readyState !== WebSocket.OPEN) return;
    const text = JSON.stringify({ watching: document.hidden ? [] : watching() });
    if (text === said && performance.now() - saidAt < SAY_EVERY_MS) return;
    socket.send(text);
    said = text;
    saidAt = performance.now();
  };
  const isSignedOut = async () => {
    const answer = await fetch("/api/session", { cache: "no-store" }).catch(() => null);
    return answer !== null && answer.status === 401;
  };
  connect();
  setInterval(draw, TICK_MS);
  document.addEventListener("visibilitychange", () => { if (data !== null) say(); });
}

/** Say on every page that the console is silent; the seconds are for the eye alone, a screen reader hears it once. */
function showLink(linked, elapsed_s) {
  const banner = $("link-banner");
  if (linked && !banner.hidden) toast("The console is there again; everything that it had confirmed is kept.");
  if (!linked && banner.hidden) {
    banner.replaceChildren("No connection to the console: nothing here is live, and nothing can be saved. It goes on by itself. ",
      el("span", { class: "number", "aria-hidden": "true" }));
  }
  banner.hidden = linked;
  if (!linked) setText(banner.lastElementChild, `Silent for ${Math.round(elapsed_s)} s.`);
}

/** How fresh something of this age is, at the oldest that it may be: the console's own limits, counted on by this page's
 *  clock. Nothing is live while the device's clock has not been compared (uncertainty_s is null). */
export function freshnessOf(age_s, uncertainty_s, connected, limits) {
  const longest_s = age_s + (uncertainty_s ?? 0);
  if (age_s === null || !connected || longest_s > limits.lost) return "lost";
  if (longest_s > limits.stale) return "stale";
  return longest_s > limits.delayed || uncertainty_s === null ? "delayed" : "live";
}

export const FRESHNESS = {
  live: { kind: "good", mark: "●", text: "LIVE" },
  delayed: { kind: "warn", mark: "◐", text: "DELAYED" },
  stale: { kind: "warn", mark: "○", text: "STALE" },
  lost: { kind: "bad", mark: "✕", text: "LOST" },
};
