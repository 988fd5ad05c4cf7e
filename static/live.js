/* The stream of what happens: reconnects by itself, and keeps honest about how old things are. */

import { isSignedOut, signInAgain, SILENT } from "./api.js";
import { $, ago, el, setText } from "./dom.js";
import { ConsoleClock } from "./page_clock.js";
import { toast } from "./toast.js";

const RETRY_MS = [500, 1000, 2000, 4000];
const SILENT_AFTER_S = 3;
const SAY_EVERY_MS = 3000;
const TICK_MS = 250;
const ASK_CLOCK_MS = [200, 400, 800, 2000];
const SIGNED_OUT = 4401;
/** So soon what a page that stood still itself had not heard yet is there: the console had not gone. */
const CATCHES_UP_MS = 1000;
let isInFrame = false;
let silentSince_ms = 0;

/**
 * Hear the stream at `path()`, asked for anew at each connecting. `take(data, page_received_s)` hears each message, `draw(link)` follows in
 * the next frame, once however many came, and four times a second in between. `watching()` returns the ids of the devices whose walkers the page shows now: of these it is sent
 * everything, and the walkers are told who watches; nobody watches by a page that cannot be seen. Returns the link: what is known of the
 * console, and `reconnect()`.
 */
export function listen(path, { take, draw, watching = () => [] }) {
  const link = new Link(path, take, draw, watching);
  link.connect();
  setInterval(() => link.tick(), TICK_MS);
  // A tab that was asleep shows what it had, and dates it, before anything else.
  document.addEventListener("visibilitychange", () => link.tick());
  addEventListener("pageshow", () => link.tick());
  return link;
}

class Link {
  constructor(path, take, draw, watching) {
    Object.assign(this, { path, take, draw, watching });
    this.said = "";
    this.saidAt = 0;
    this.isDue = false;
    this.console = new ConsoleClock();
    this.heardAt_s = null;
    this.failures = 0;
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}${this.path()}`);
    this.socket = socket;
    this.said = "";
    let opened = false;
    socket.onopen = () => {
      opened = true;
      if (this.failures > 0) takeBackSilence();
      this.failures = 0;
      this.console.forget();
      this.askClock(socket, 0);
    };
    socket.onmessage = (event) => {
      if (this.socket === socket) this.heard(JSON.parse(event.data));
    };
    socket.onclose = async (event) => {
      if (event.code === SIGNED_OUT) return signInAgain();
      if (!opened && (await isSignedOut())) return signInAgain();
      if (this.socket !== socket) return;
      setTimeout(() => this.connect(), RETRY_MS[Math.min(this.failures++, RETRY_MS.length - 1)]);
    };
  }

  /** Ask for another stream at once: the path has changed. */
  reconnect() {
    const old = this.socket;
    this.connect();
    old.close();
  }

  askClock(socket, count) {
    if (socket.readyState !== WebSocket.OPEN) return;
    socket.send(JSON.stringify({ type: "clock", page_sent_s: this.console.clock.now_s() }));
    setTimeout(() => this.askClock(socket, count + 1), ASK_CLOCK_MS[Math.min(count, ASK_CLOCK_MS.length - 1)]);
  }

  heard(data) {
    const page_s = this.console.clock.now_s();
    this.heardAt_s = page_s;
    if (data.type === "clock") return this.console.add(data.page_sent_s, data.console_received_s, data.console_sent_s, page_s);
    this.take(data, page_s);
    return this.drawInFrame();
  }

  /** Draw once in the next frame. A tab that nobody can see has no frames: what comes then is drawn by the clock. */
  drawInFrame() {
    if (this.isDue) return;
    this.isDue = true;
    requestAnimationFrame(() => {
      this.isDue = false;
      isInFrame = true;
      try {
        this.tick();
      } finally {
        isInFrame = false;
      }
    });
  }

  tick() {
    if (this.heardAt_s === null) return;
    showLink(this.isLinked, this.silence_s);
    this.draw(this);
    this.say();
  }

  /** Say which walkers are shown now, at once where that is news. */
  say() {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    const text = JSON.stringify({ type: "watching", watching: document.hidden ? [] : this.watching() });
    if (text === this.said && performance.now() - this.saidAt < SAY_EVERY_MS) return;
    this.socket.send(text);
    this.said = text;
    this.saidAt = performance.now();
  }

  /** How long the console has said nothing. */
  get silence_s() {
    return this.console.clock.now_s() - this.heardAt_s;
  }

  get isLinked() {
    return this.silence_s < SILENT_AFTER_S;
  }

  /** How long ago something was that happened at `console_s` by the console's clock, and came here at `page_s`: at least and at the most.
   *  The most is null while the clocks have not been compared. */
  since(console_s, page_s) {
    const console = this.console.now();
    if (console === null) return { least_s: this.console.clock.now_s() - page_s, most_s: null };
    const age_s = console.now_s - console_s;
    return { least_s: Math.max(0, age_s - console.uncertainty_s), most_s: Math.max(0, age_s + console.uncertainty_s) };
  }
}

/**
 * Follow the whole picture. Call `show(data, elapsed_s, linked, doubt_s)` at each message and in between. `elapsed_s` is how long ago the
 * console made the picture: add it to every age. `data.roster` is who is there, and what they run. `doubt_s` is how much longer it may be, null while nobody knows. `linked` is false once the
 * console has gone silent. `devices()` says whose whole picture is wanted: "devices=one&device=glasses", "devices=none", or all;
 * `watching()` which of these walkers are shown.
 */
export function follow(show, devices = () => "", watching = () => []) {
  let data = null;
  let roster = [];
  let parts = new Map();
  let receivedAt_s = 0;
  const link = listen(() => `/live?says=1&${devices()}`, {
    watching,
    take(picture, page_s) {
      roster = picture.roster ?? roster;
      parts = partsNow(parts, picture);
      data = { ...picture, roster, devices: picture.devices.map((device) => ({ ...device, ...partsAt(parts.get(device.id), picture.now_s) })) };
      receivedAt_s = page_s;
    },
    draw(link) {
      if (data === null) return;
      const { least_s, most_s } = link.since(data.now_s, receivedAt_s);
      show(data, least_s, link.isLinked, most_s === null ? null : most_s - least_s);
    },
  });
  return {
    /** The console's time now, as well as it is known; null where it is not. */
    consoleTime: () => link.console.now()?.now_s ?? null,
    /** Another device is wanted: what was known of the last one is not shown any more. */
    again() {
      data = null;
      link.reconnect();
    },
  };
}

/** The parts of each device that is there, with those that a message tells: the others are as they were. */
function partsNow(known, { devices, parts = {} }) {
  return new Map(devices.map(({ id }) => [id, { ...known.get(id), ...parts[id] }]));
}

/** Parts as they are at `now_s`: each was told with the ages that it had then. */
function partsAt(parts = {}, now_s) {
  return Object.fromEntries(Object.entries(parts).map(([name, { now_s: then_s, value }]) => [name, older(value, now_s - then_s)]));
}

function older(value, by_s) {
  if (Array.isArray(value)) return value.map((each) => older(each, by_s));
  if (value === null || value.age_s === undefined) return value;
  const left_s = value.shelf_left_s ?? null;
  return { ...value, age_s: value.age_s + by_s, ...(left_s !== null && { shelf_left_s: Math.max(0, left_s - by_s) }) };
}

/** Do something once the browser has drawn what is drawn now. */
export function onScreen(act) {
  if (isInFrame) setTimeout(act);
  else requestAnimationFrame(() => setTimeout(act));
}

/** Nothing goes on saying that the console does not answer once it does. */
function takeBackSilence() {
  for (const problem of document.querySelectorAll(".problem")) if (problem.textContent === SILENT) setText(problem, "");
}

/** Say on every page that the console is silent; the seconds are for the eye alone, a screen reader hears it once. */
function showLink(linked, silence_s) {
  const banner = $("link-banner");
  if (linked && !banner.hidden && performance.now() - silentSince_ms > CATCHES_UP_MS) toast("The console is there again; everything that it had confirmed is kept.");
  if (!linked && banner.hidden) {
    silentSince_ms = performance.now();
    banner.replaceChildren("No connection to the console: nothing here is live, and nothing can be saved. It goes on by itself. ",
      el("span", { class: "number", "aria-hidden": "true" }));
  }
  banner.hidden = linked;
  if (!linked) setText(banner.lastElementChild, `Silent for ${Math.round(silence_s)} s.`);
}

/** How fresh what a page shows of a device is; "not_told" before it is told anything: the walker hears first that somebody watches. */
export function freshnessOfDevice({ is_told, connected }, age_s, uncertainty_s, limits) {
  return is_told ? freshnessOf(age_s, uncertainty_s, connected, limits) : "not_told";
}

/** How fresh something of this age is, at the oldest that it may be: the console's own limits, counted on by this page's
 *  clock. Nothing is live while a clock on the way has not been compared (uncertainty_s is null). */
export function freshnessOf(age_s, uncertainty_s, connected, limits) {
  const longest_s = age_s + (uncertainty_s ?? 0);
  if (age_s === null || !connected || longest_s > limits.lost) return "lost";
  if (longest_s > limits.stale) return "stale";
  return longest_s > limits.delayed || uncertainty_s === null ? "delayed" : "live";
}

/** Whether something is too old to be told as now. */
export function isPast(fresh) {
  return fresh === "stale" || fresh === "lost";
}

/** How wrong an age may be: what each clock on the way may add; null where one of them has not been compared. */
export function doubt(...parts_s) {
  return parts_s.includes(null) ? null : parts_s.reduce((sum, part) => sum + part, 0);
}

export const FRESHNESS = {
  not_told: { kind: "", mark: "○", text: "…" },
  live: { kind: "good", mark: "●", text: "LIVE" },
  delayed: { kind: "warn", mark: "◐", text: "DELAYED" },
  stale: { kind: "warn", mark: "○", text: "STALE" },
  lost: { kind: "bad", mark: "✕", text: "LOST" },
};

/** The words of a badge: how fresh, and how old where it is not live and that says more than "now". */
function freshnessWords(fresh, age_s) {
  return fresh === "live" || fresh === "not_told" || age_s === null || age_s < 1 ? FRESHNESS[fresh].text : `${FRESHNESS[fresh].text}, ${ago(age_s)}`;
}

/** Show how fresh something is on a badge. */
export function showBadge(node, fresh, age_s) {
  node.className = `badge ${FRESHNESS[fresh].kind}`;
  node.dataset.mark = FRESHNESS[fresh].mark;
  setText(node, freshnessWords(fresh, age_s));
}
