/* What-if: what the draft would have changed in a walk that was recorded, with a timeline of then and now. */

import { ask, get, post } from "./api.js";
import { badge, decimals, el, setText } from "./dom.js";
import { humanName } from "./setting-words.js";

const LOOK_MS = 500;
const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 76;
const BANDS = [["then", 4], ["now", 34]];
const SCOPES = [["", "the whole walk"], ["120", "its last 2 minutes"], ["300", "its last 5 minutes"], ["900", "its last 15 minutes"]];

export class WhatIf {
  /** `draft()` returns the changes to judge. */
  constructor(root, specs, draft) {
    Object.assign(this, { root, draft, byKey: new Map(specs.map((spec) => [spec.key, spec])), run: null });
    this.walk = el("select", { id: "what-if-walk" });
    this.scope = el("select", { id: "what-if-scope" }, ...SCOPES.map(([value, title]) => el("option", { value }, title)));
    this.start = el("button", { type: "button", class: "primary", onclick: () => this.ask() }, "What if…");
    this.stop = el("button", { type: "button", hidden: true, onclick: () => this.cancel() }, "Give up");
    this.says = el("p", { role: "status", class: "quiet" });
    this.bar = el("div", { class: "progress", hidden: true, role: "progressbar", "aria-label": "Replay", "aria-valuemin": 0, "aria-valuemax": 100 }, el("div"));
    this.answer = el("div", { class: "stack" });
    root.append(el("h2", { id: "what-if-title" }, "What if"),
      el("p", { class: "quiet" }, "A recorded walk is guided again under the draft. The walker went where they went then: this shows what guidance would have said at each place, not where they would have walked."),
      el("div", { class: "form-grid" }, el("div", { class: "field" }, el("label", { for: "what-if-walk" }, "Walk"), this.walk), el("div", { class: "field" }, el("label", { for: "what-if-scope" }, "Of it"), this.scope),
        el("div", { class: "row" }, this.start, this.stop)), this.bar, this.says, this.answer);
  }

  async load() {
    const { walks } = await get("/api/what-if/walks");
    this.walk.replaceChildren(...walks.map((walk) => el("option", { value: walk.walk_id },
      `${new Date(walk.began_at_s * 1000).toLocaleString()} · ${walk.device} · ${duration(walk.length_s)}`)));
    this.start.disabled = this.walk.disabled = walks.length === 0;
    if (!walks.length) {
      this.walk.append(el("option", {}, "none yet"));
      setText(this.says, "No recorded walk has come to this console yet: devices that record send them when they are at rest.");
    }
  }

  async ask() {
    this.root.scrollIntoView({ block: "start" });
    this.start.focus();
    const changes = this.draft();
    if (!Object.keys(changes).length) return setText(this.says, "The draft is empty: change a setting first.");
    if (this.walk.disabled) return undefined;
    this.answer.replaceChildren();
    try {
      this.show(await post("/api/what-if", { walk_id: this.walk.value, changes, last_s: this.scope.value ? Number(this.scope.value) : null }));
      await this.wait(this.run.run_id);
    } catch (error) {
      this.show({ state: "failed", why: error.message, not_judged: [], changes });
    }
    return undefined;
  }

  async wait(runId) {
    while (this.run.run_id === runId && ["waiting", "running"].includes(this.run.state)) {
      await new Promise((resolve) => { setTimeout(resolve, LOOK_MS); });
      const seen = await get(`/api/what-if/${runId}`);
      if (this.run.run_id === runId) this.show(seen);
    }
  }

  cancel() {
    return ask("DELETE", `/api/what-if/${this.run.run_id}`).catch(() => null);
  }

  show(run) {
    this.run = run;
    const busy = run.state === "waiting" || run.state === "running";
    this.stop.hidden = this.bar.hidden = !busy;
    this.bar.firstElementChild.style.width = `${run.percent ?? 0}%`;
    this.bar.setAttribute("aria-valuenow", run.percent ?? 0);
    const words = { waiting: "Waits for another question.", running: "The walk is guided again…", failed: `No answer: ${run.why}`, cancelled: "It was given up.", done: "" };
    setText(this.says, words[run.state] || (run.result ? summary(run.result) : ""));
    if (!busy) this.answer.replaceChildren(...this.unjudged(run), ...(run.result ? this.result(run.result) : []));
  }

  unjudged({ not_judged: keys }) {
    if (!keys.length) return [];
    const names = keys.map((key) => humanName(this.byKey.get(key))).join(", ");
    return [el("p", { class: "note warn" }, badge("warn", "?", "not judged"), ` ${names}: poses, what stands in the way and the device’s pace are in a recording as they were then. What this changes cannot be seen without the pictures.`)];
  }

  result(result) {
    const instant = el("div", { class: "instant", "aria-live": "polite" });
    const slider = el("input", { type: "range", min: 0, max: result.length_s, step: "any", value: 0, "aria-label": "Instant of the walk" });
    const chart = timeline(result, (at_s) => { slider.value = at_s; show(); });
    const show = () => {
      const at_s = Number(slider.value);
      slider.setAttribute("aria-valuetext", `${decimals(at_s, 1)} s`);
      chart.mark(at_s);
      const found = result.instants.findLast((one) => one.at_s <= at_s + 1e-6) ?? result.instants[0];
      instant.replaceChildren(el("p", { class: "small quiet number" }, `${decimals(at_s, 1)} s`), el("p", {}, el("strong", {}, "Then: "), found.then), el("p", {}, el("strong", {}, "Now: "), found.now));
    };
    const jump = (step) => {
      const at_s = Number(slider.value);
      const starts = result.different.map(({ from_s }) => from_s);
      const next = step > 0 ? starts.find((start) => start > at_s + 1e-6) : starts.findLast((start) => start < at_s - 1e-6);
      if (next !== undefined) { slider.value = next; show(); }
    };
    const none = result.different.length === 0;
    const buttons = el("div", { class: "row" }, el("button", { type: "button", class: "slim", disabled: none, onclick: () => jump(-1) }, "Difference before"), el("button", { type: "button", class: "slim", disabled: none, onclick: () => jump(1) }, "Next difference"));
    if (!none) slider.value = result.different[0].from_s;
    show();
    return [comparison(result), el("figure", { class: "timeline" }, chart.node, slider, el("figcaption", { class: "small quiet" }, "Above: then. Below: now. Marked: where the walker would have heard or done something else.")), buttons, instant];
  }
}

function summary({ different_s, length_s, different }) {
  if (!different.length) return `In all ${duration(length_s)} nothing would have been different for the walker.`;
  return `Different for ${duration(different_s)} of ${duration(length_s)}, in ${different.length} stretch${different.length === 1 ? "" : "es"}.`;
}

function comparison({ then, now }) {
  const line = (title, of, digits = 0) => {
    const [before, after] = [of(then), of(now)];
    const text = (value) => (value === null ? "–" : decimals(value, digits));
    const change = before === null || after === null ? "–" : decimals(after - before, digits);
    return el("tr", { class: change !== "–" && Number(change) !== 0 ? "differs" : "" }, el("th", { scope: "row" }, title), ...[text(before), text(after), Number(change) > 0 ? `+${change}` : change].map((words) => el("td", { class: "number" }, words)));
  };
  const reasons = [...new Set([...Object.keys(then.stops_by_reason), ...Object.keys(now.stops_by_reason)])];
  const lines = [
    line("Walk (s)", ({ seconds }) => seconds.walk, 1), line("Turn on the spot (s)", ({ seconds }) => seconds.turn, 1), line("Stop (s)", ({ seconds }) => seconds.stop, 1),
    line("Stops", ({ stop_count }) => stop_count), ...reasons.map((reason) => line(`– ${reason}`, ({ stops_by_reason }) => stops_by_reason[reason] ?? 0)),
    line("No way free", ({ no_way_count }) => no_way_count), line("Called back to the road", ({ off_road_count }) => off_road_count), line("Cues", ({ cue_count }) => cue_count),
    line("Mean deviation (m)", ({ mean_deviation_m }) => mean_deviation_m, 2),
  ];
  const head = ["", "Then", "Now", "Difference"].map((title) => el("th", { scope: "col", class: title ? "number" : "" }, title || el("span", { class: "visually-hidden" }, "Figure")));
  return el("div", { class: "table-wrap", role: "region", tabindex: 0, "aria-label": "Then and now" }, el("table", { class: "what-if-figures", "aria-label": "Then and now" }, el("thead", {}, el("tr", {}, ...head)), el("tbody", {}, ...lines)));
}

/** Two bands of actions over time; `choose(at_s)` hears a click. */
function timeline({ bands, different, length_s }, choose) {
  const svg = drawn("svg", { viewBox: `0 0 1000 ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const x = (at_s) => (1000 * at_s) / length_s;
  for (const [side, y] of BANDS) {
    for (const band of bands) svg.append(drawn("rect", { x: x(band.from_s), y, width: Math.max(0.5, x(band.to_s - band.from_s)), height: 26, class: `band-${band[side]}` }));
  }
  for (const { from_s, to_s } of different) svg.append(drawn("rect", { x: x(from_s), y: 66, width: Math.max(2, x(to_s - from_s)), height: 8, class: "band-different" }));
  const here = drawn("line", { y1: 0, y2: HEIGHT, class: "band-here" });
  svg.append(here);
  svg.addEventListener("click", (event) => {
    const box = svg.getBoundingClientRect();
    choose((length_s * (event.clientX - box.left)) / box.width);
  });
  const key = el("p", { class: "row small band-key" }, ...["walk", "turn", "stop"].map((action) => el("span", { class: `key-${action}` }, action)));
  return { node: el("div", {}, key, svg), mark: (at_s) => { here.setAttribute("x1", x(at_s)); here.setAttribute("x2", x(at_s)); } };
}

function drawn(tag, attributes) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

function duration(seconds) {
  return seconds < 90 ? `${decimals(seconds, seconds < 10 ? 1 : 0)} s` : `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}
