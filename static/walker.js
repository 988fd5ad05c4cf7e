/* The walker's state in words and figures. */

import { $, ago, el, icon, metres, onChange, setText } from "./dom.js";

const QUALITY = { localized: "● Known", uncertain: "◐ Uncertain", lost: "✕ Lost" };
const SONAR = { no_echo: "no echo", stale: "silent", absent: "none" };
const SPOKEN = { walk: "Walking.", turn: "Turning.", stop: "Standing." };
/** States in which guidance says what the walker is told to do, and why; in the others the state says it all. */
const GUIDED = ["guiding", "lost", "fault"];
const DEPTH_EVERY_MS = 400;

export class Walker {
  constructor() {
    this.depthAskedAt = 0;
    this.drawSign = onChange((name) => $("now-sign").replaceChildren(icon(name)));
    this.drawFigures = onChange((figures) => $("figures").replaceChildren(
      ...figures.map(([term, value, unit]) => el("div", {}, el("dt", {}, term), el("dd", {}, `${value} `, el("small", {}, unit || ""))))));
    this.drawEvents = onChange((events) => drawEvents(events));
  }

  /** Show a device, as data of the live stream; null for none. */
  show(device, { elapsed_s, age_s, fresh, poi }) {
    const state = device?.state ?? null;
    $("no-device").hidden = device !== null;
    $("now").hidden = state === null;
    $("figures-section").hidden = state === null;
    this.showDate(device, age_s, fresh);
    this.showDepth(device, elapsed_s);
    this.drawEvents((device?.events ?? []).map((event) => ({ ...event, age_s: undefined, ago: ago(event.age_s + elapsed_s) })));
    if (state === null) return;
    const name = device.state.destination_id ? poi(state.destination_id)?.name ?? state.destination_id : null;
    this.showNow(state, name, elapsed_s);
    this.showProgress(device, state, name);
    this.drawFigures(figures(device, state));
  }

  showDate(device, age_s, fresh) {
    const dated = $("dated");
    dated.hidden = !device || fresh === "live" || fresh === "delayed";
    if (dated.hidden) return;
    const since = age_s === null ? "It has sent nothing yet." : `What is shown is from ${ago(age_s)}.`;
    setText(dated, device.connected ? since : `${device.name} is not connected. ${since} Guidance goes on without the console.`);
  }

  showNow(state, name, elapsed_s) {
    const { sign, words } = decision(state, name);
    const guided = GUIDED.includes(state.mode);
    $("now").dataset.mode = state.mode;
    $("now").dataset.action = state.action;
    this.drawSign(sign);
    setText($("now-state"), state.mode_label);
    setText($("now-action"), words);
    const reason = guided ? state.reason : state.mode_sentence;
    setText($("now-reason"), state.mode === "ready" ? `${reason} Choose where to go below.` : reason);
    // For screen readers: what changes a few times a minute, not every degree.
    setText($("now-said"), `${state.mode_label}. ${guided ? `${SPOKEN[state.action]} ` : ""}${reason}`);
    $("now-cue").hidden = !state.last_cue;
    setText($("now-cue-text"), state.last_cue);
    setText($("now-cue-age"), state.last_cue_age_s === null ? "" : ago(state.last_cue_age_s + elapsed_s));
  }

  showProgress(device, state, name) {
    const stops = device.route?.stops ?? [];
    const whole_m = stops.length ? stops[stops.length - 1][1] : null;
    const shown = Boolean(name && whole_m && state.remaining_m !== null);
    $("progress-block").hidden = !shown;
    if (!shown) return;
    const share = Math.max(0, Math.min(100, Math.round(100 * (1 - state.remaining_m / whole_m))));
    $("progress").setAttribute("aria-valuenow", share);
    $("progress").firstElementChild.style.width = `${share}%`;
    const next = stops.find(([, distance_m]) => distance_m > whole_m - state.remaining_m + 0.5);
    const nextWords = next && next !== stops[stops.length - 1] ? `, next ${next[0]}` : "";
    setText($("progress-text"), `${metres(state.remaining_m)} of ${metres(whole_m)} left to ${name}${nextWords}`);
  }

  showDepth(device, elapsed_s) {
    $("depth-section").hidden = !device || device.depth_stamp_s === null;
    if ($("depth-section").hidden) return;
    setText($("depth-age"), ago(device.depth_age_s + elapsed_s));
    const key = `${device.id} ${device.depth_stamp_s}`;
    if (key === this.depthKey || performance.now() - this.depthAskedAt < DEPTH_EVERY_MS) return;
    this.depthKey = key;
    this.depthAskedAt = performance.now();
    $("depth").src = `/api/devices/${encodeURIComponent(device.id)}/depth.jpg?at=${device.depth_stamp_s}`;
  }
}

/** The decision as a sign and a sentence. */
function decision(state, name) {
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

function mapNews(device) {
  return device.map_waiting ? "a newer one waits until nobody is led" : device.map_refusal;
}

function figures(device, state) {
  const sure = state.quality === "localized" && state.position_std_m !== null;
  const uncertainty = sure ? `± ${Math.max(1, Math.round(state.position_std_m * 100))} cm` : "";
  const delay = device.link_delay_s === null ? ["–"] : [Math.max(1, Math.round(device.link_delay_s * 1000)), "ms"];
  const clocks = device.age_uncertainty_s === null ? ["not compared yet"]
    : [`± ${Math.max(1, Math.round(device.age_uncertainty_s * 1000))}`, "ms"];
  return [
    ["Position", QUALITY[state.quality], uncertainty],
    ["Off the route by", metres(state.deviation_m, 2)],
    ["Distance left", metres(state.remaining_m)],
    ["Speed", ...(state.speed_m_s === null ? ["–"] : [state.speed_m_s.toFixed(1), "m/s"])],
    ["Nearest ahead (camera)", state.nearest_ahead_m === null ? "free" : metres(state.nearest_ahead_m)],
    ["Ultrasonic", state.sonar_state === "ok" ? metres(state.sonar_m) : SONAR[state.sonar_state]],
    ["Camera pictures", state.frame_rate_hz.toFixed(0), `per second, ${state.cycle_ms.toFixed(0)} ms each`],
    ["Link delay", ...delay],
    ["Clocks compared", ...clocks],
    ["Map", device.map_checksum.slice(0, 8) || "–", mapNews(device)],
  ];
}

function drawEvents(events) {
  $("no-events").hidden = events.length > 0;
  $("events").replaceChildren(...events.map((event) => el("li", {},
    el("time", {}, event.ago), el("div", {}, event.text, el("span", { class: "kind" }, event.kind.replace("_", " "))))));
}
