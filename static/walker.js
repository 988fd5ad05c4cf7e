/* The walker's state in words and figures: of now, or of any instant that is given in the form of the live stream. */

import { ago, el, icon, metres, onChange, setText } from "./dom.js";
import { isPast } from "./live.js";

const QUALITY = { localized: "● Known", uncertain: "◐ Uncertain", lost: "✕ Lost" };
const SONAR = { no_echo: "no echo", stale: "silent", absent: "none" };
const SPOKEN = { walk: "Walking.", turn: "Turning.", stop: "Standing." };
/** States in which guidance says what the walker is told to do, and why; in the others the state says it all. */
const GUIDED = ["guiding", "lost", "fault"];
const DEPTH_EVERY_MS = 400;

export class Walker {
  /** Builds its parts in empty elements: `now` (what the walker is told), `figures`, `depth` (the silhouette), `events`; each may be missing.
   *  `prefix` stands before the ids of what is built. `depthUrl(device)` is where its silhouette comes from. */
  constructor(places, { prefix = "", depthUrl = liveDepthUrl } = {}) {
    this.parts = [
      places.now && new Now(places.now, prefix), places.figures && new Figures(places.figures, prefix),
      places.depth && new Depth(places.depth, prefix, depthUrl), places.events && new Events(places.events, prefix),
    ].filter(Boolean);
  }

  /** Show a device, as data of the live stream; null for none. `elapsed_s` is added to every age in it; `poi(id)` is a place of the map. */
  show(device, { elapsed_s, age_s, fresh, poi }) {
    const id = device?.state?.destination_id;
    const seen = { elapsed_s, age_s, fresh, name: id ? poi(id)?.name ?? id : null };
    for (const part of this.parts) part.show(device, seen);
  }
}

const liveDepthUrl = (device) => `/api/devices/${encodeURIComponent(device.id)}/depth.jpg?at=${device.depth_stamp_s}`;

/** What the walker is told, and why. */
class Now {
  constructor(root, prefix) {
    const make = (tag, name, attributes = {}) => { this[name] = el(tag, { id: `${prefix}${name}`, ...attributes }); return this[name]; };
    const cue = make("p", "now-cue", { class: "cue", hidden: true });
    cue.append(el("span", { class: "quiet small" }, "The walker heard"), make("q", "now-cue-text", { "aria-live": "polite" }), make("span", "now-cue-age", { class: "quiet small number" }));
    const card = make("section", "now", { class: "now", "aria-label": "What the walker is told", hidden: true });
    card.append(make("div", "now-sign", { class: "sign fades" }), make("p", "now-state", { class: "state fades" }), make("p", "now-action", { class: "action fades" }), make("p", "now-reason", { class: "reason fades" }), cue);
    root.replaceChildren(make("p", "dated", { class: "dated", role: "status", hidden: true }), make("p", "now-said", { class: "visually-hidden", role: "status" }), card);
    this.drawSign = onChange((name) => this["now-sign"].replaceChildren(icon(name)));
    this.said = "";
  }

  show(device, { elapsed_s, age_s, fresh, name }) {
    const state = device?.state ?? null;
    this.showDate(device, age_s, fresh);
    this.now.hidden = state === null;
    if (state === null) return;
    const { sign, words } = decision(state, name, fresh);
    const guided = GUIDED.includes(state.mode);
    const past = isPast(fresh);
    this.now.dataset.mode = state.mode;
    this.now.dataset.action = state.action;
    this.drawSign(sign);
    const label = past ? `Last heard: ${state.mode_label}` : state.mode_label;
    setText(this["now-state"], label);
    setText(this["now-action"], words);
    // Never the bare reason: that one calls the way free, though nobody may have measured it.
    const reason = past ? reasonOfThen(state) : guided ? state.trace.sentence : state.mode_sentence;
    setText(this["now-reason"], reason);
    // For screen readers: a few times a minute, not with every degree and metre of the sentence.
    this.say(`${label} ${state.action} ${state.reason} ${past}`, `${label}. ${guided && !past ? `${SPOKEN[state.action]} ` : ""}${reason}`);
    this["now-cue"].hidden = !state.last_cue;
    setText(this["now-cue-text"], state.last_cue);
    setText(this["now-cue-age"], state.last_cue_age_s === null ? "" : ago(state.last_cue_age_s + elapsed_s));
  }

  /** Say `words` where what they tell of, `about`, is another than before. */
  say(about, words) {
    if (about === this.said) return;
    this.said = about;
    setText(this["now-said"], words);
  }

  showDate(device, age_s, fresh) {
    const { dated } = this;
    dated.hidden = !device || !isPast(fresh);
    if (dated.hidden) return;
    const since = age_s === null ? "It has sent nothing yet." : `What is shown is from ${ago(age_s)}.`;
    const led = GUIDED.includes(device.state?.mode) ? " Whether guidance goes on is not known." : "";
    setText(dated, `${device.connected ? "" : "Not connected. "}${since}${led}`);
  }
}

/** Why the walker was told to stand, as the device said it then; that a way was free is not said of what is over. */
function reasonOfThen({ mode, action, reason }) {
  return GUIDED.includes(mode) && action === "stop" ? `The reason then: ${reason}` : "";
}

/** The decision as a sign and a sentence: in the past tense where the device was not heard of late. */
export function decision(state, name, fresh) {
  const { sign, words } = decisionNow(state, name);
  return { sign, words: isPast(fresh) ? inThePast(words) : words };
}

function inThePast(words) {
  if (words === "Stop") return "Was told to stand";
  if (words.startsWith("Arrived")) return `Had a${words.slice(1)}`;
  return `Was ${words[0].toLowerCase()}${words.slice(1)}`;
}

function decisionNow(state, name) {
  const towards = name ? ` to ${name}` : "";
  const words = {
    off_duty: "Off duty", mapping: "Recording a map", localizing: "Finding the position", ready: "Waiting for a destination",
    paused: `Paused${name ? `, on the way to ${name}` : ""}`, arrived: name ? `Arrived at ${name}` : "Arrived",
  }[state.mode];
  if (words) return { sign: state.mode, words };
  if (state.action === "stop") return { sign: state.mode === "guiding" ? "stop" : state.mode, words: "Stop" };
  const degrees = state.direction_rad === null ? 0 : Math.round((state.direction_rad * 180) / Math.PI);
  const side = degrees > 0 ? "left" : "right";
  if (state.action === "turn") return { sign: side, words: `Turning ${side}, ${Math.abs(degrees)}°` };
  if (Math.abs(degrees) < 10) return { sign: "walk", words: `Walking${towards}` };
  return { sign: "walk", words: `Walking${towards}, ${Math.abs(degrees)}° ${side}` };
}

const LOAD = {
  full: "", fewer_features: "; too slow: fewer features", half_rate: "; too slow: every second one is located",
};

/** The walk, the device and the versions in figures. */
class Figures {
  constructor(root, prefix) {
    this.root = root;
    this.progressText = el("p", { class: "small quiet", id: `${prefix}progress-text` });
    this.bar = el("div", { class: "progress fades", id: `${prefix}progress`, role: "progressbar", "aria-label": "Part of the way that is done", "aria-valuemin": "0", "aria-valuemax": "100" }, el("div"));
    this.progress = el("div", { class: "stack tight", hidden: true }, this.progressText, this.bar);
    this.lists = FIGURES.map(([title, of]) => {
      const list = el("dl", { class: "figures fades" });
      const draw = onChange((figures) => list.replaceChildren(...figures.map(([term, value, unit]) => el("div", {}, el("dt", {}, term), el("dd", {}, `${value} `, el("small", {}, unit || ""))))));
      return { of, draw, node: el("div", { class: "stack tight" }, el("h3", { class: "quiet" }, title), list) };
    });
    root.replaceChildren(this.progress, ...this.lists.map(({ node }) => node));
    root.hidden = true;
  }

  show(device, { elapsed_s, name }) {
    const state = device?.state ?? null;
    this.root.hidden = state === null;
    if (state === null) return;
    this.showProgress(device, state, elapsed_s, name);
    for (const { of, draw } of this.lists) draw(of(device, state));
  }

  showProgress(device, state, elapsed_s, name) {
    const stops = device.route?.stops ?? [];
    const whole_m = stops.length ? stops[stops.length - 1][1] : null;
    this.progress.hidden = !(name && whole_m && state.remaining_m !== null);
    if (this.progress.hidden) return;
    const share = Math.max(0, Math.min(100, Math.round(100 * (1 - state.remaining_m / whole_m))));
    this.bar.setAttribute("aria-valuenow", share);
    this.bar.firstElementChild.style.width = `${share}%`;
    const next = stops.find(([, distance_m]) => distance_m > whole_m - state.remaining_m + 0.5);
    const nextWords = next && next !== stops[stops.length - 1] ? `, next ${next[0]}` : "";
    const planned = device.route.age_s === undefined ? "" : `; planned ${ago(device.route.age_s + elapsed_s)}`;
    setText(this.progressText, `${metres(state.remaining_m)} of ${metres(whole_m)} left to ${name}${nextWords}${planned}`);
  }
}

const FIGURES = [
  ["The walk", (device, state) => {
    const sure = state.quality === "localized" && state.position_std_m !== null;
    return [
      ["Position", QUALITY[state.quality], sure ? `± ${Math.max(1, Math.round(state.position_std_m * 100))} cm` : ""],
      ["Off the route by", metres(state.deviation_m, 2)],
      ["Distance left", metres(state.remaining_m)],
      ["Speed", ...(state.speed_m_s === null ? ["–"] : [state.speed_m_s.toFixed(1), "m/s"])],
      ["Nearest ahead (camera)", state.nearest_ahead_m === null ? "nothing seen" : metres(state.nearest_ahead_m)],
      ["Ultrasonic", state.sonar_state === "ok" ? metres(state.sonar_m) : SONAR[state.sonar_state]],
    ];
  }],
  ["The device", (device, state) => [
    ["Battery", ...battery(state)],
    ["Temperature", ...known(state.temperature_c, (value) => [value.toFixed(0), "°C"])],
    ["Camera pictures", state.frame_rate_hz.toFixed(0), `per second, ${state.cycle_ms.toFixed(0)} ms each${LOAD[state.load_level]}`],
    ["Link delay", ...known(device.link_delay_s, milliseconds)],
    ["Capture to screen", ...known(device.capture_to_screen_s, milliseconds)],
    ["Clocks compared", ...(device.age_uncertainty_s === null ? ["not yet"] : [`± ${milliseconds(device.age_uncertainty_s)[0]}`, "ms"])],
  ]],
  ["What runs", (device) => [
    ["Software", device.software || "–"],
    ["Map", device.map_checksum.slice(0, 8) || "–", device.map_waiting ? "a newer one waits until nobody is led" : device.map_refusal],
    ["Places and ways", `version ${device.graph_version}`, device.graph_refusal],
    ["Settings", `revision ${device.settings_revision}`],
  ]],
];

const known = (value, words) => (value === null || value === undefined ? ["not told"] : words(value));
const milliseconds = (value_s) => [Math.max(1, Math.round(value_s * 1000)), "ms"];

function battery({ battery_percent: percent, is_charging: charging }) {
  return known(percent, (value) => [`${value.toFixed(0)} %`, charging ? "charging" : ""]);
}

/** The depth silhouette, with its own age. */
class Depth {
  constructor(root, prefix, url) {
    Object.assign(this, { root, url, key: "", askedAt_ms: -Infinity });
    this.image = el("img", { id: `${prefix}depth`, alt: "Depth silhouette: near things are bright" });
    this.age = el("figcaption", { id: `${prefix}depth-age` });
    this.figure = el("figure", { class: "depth" }, this.image, this.age);
    root.replaceChildren(this.figure);
    root.hidden = true;
  }

  show(device, { elapsed_s }) {
    this.root.hidden = !device || device.depth_stamp_s === null;
    if (this.root.hidden) return;
    const age_s = device.depth_age_s + elapsed_s;
    this.figure.dataset.old = String(age_s > DEPTH_OLD_S || !device.connected);
    setText(this.age, age_s > DEPTH_OLD_S ? `Old picture, ${ago(age_s)}` : ago(age_s));
    const key = `${device.id} ${device.depth_stamp_s}`;
    if (key === this.key || performance.now() - this.askedAt_ms < DEPTH_EVERY_MS) return;
    this.key = key;
    this.askedAt_ms = performance.now();
    this.image.src = this.url(device);
  }
}

const DEPTH_OLD_S = 5;

/** What happened, the newest first. */
class Events {
  constructor(root, prefix) {
    this.none = el("p", { class: "empty", id: `${prefix}no-events` }, "Nothing has happened yet.");
    this.list = el("ol", { class: "events", id: `${prefix}events`, role: "log", "aria-live": "off" });
    root.replaceChildren(this.none, this.list);
    this.draw = onChange((events) => {
      this.none.hidden = events.length > 0;
      this.list.replaceChildren(...events.map((event) => el("li", {},
        el("time", {}, event.ago), el("div", {}, event.text, el("span", { class: "kind" }, event.kind.replace("_", " "))))));
    });
  }

  show(device, { elapsed_s }) {
    this.draw((device?.events ?? []).map((event) => ({ ...event, age_s: undefined, ago: ago(event.age_s + elapsed_s) })));
  }
}
