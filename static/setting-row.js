/* One setting on the page: a slider with a number, a choice or a check; what it runs, what the draft says, what is wrong. */

import { badge, el, setText } from "./dom.js";
import { humanName, valueWords } from "./setting-words.js";

export class SettingRow {
  /** `change(spec, value)` hears what somebody has entered; null where it is no number. */
  constructor(spec, change) {
    this.spec = spec;
    this.change = change;
    this.id = spec.key.replace(".", "-");
    const title = el("div", { class: "title" }, el("label", { for: this.id }, humanName(spec)));
    if (spec.safety) title.append(badge("warn", "▲", "safety"));
    this.state = el("p", { class: "state", "aria-live": "polite" });
    this.problem = el("p", { class: "problem small", id: `${this.id}-problem`, role: "alert" });
    this.undo = el("button", { type: "button", class: "plain slim", hidden: true, onclick: () => this.giveBack(this.running) }, "");
    this.reset = el("button", { type: "button", class: "plain slim", hidden: true, onclick: () => this.giveBack(spec.default) }, `Default: ${valueWords(spec, spec.default)}`);
    this.control = this.build();
    const paper = spec.paper === null ? "" : ` · paper ${valueWords(spec, spec.paper)}`;
    this.node = el("div", { class: "setting", id: `setting-${this.id}` },
      el("div", {}, title, el("p", { class: "meaning", id: `${this.id}-meaning` }, spec.meaning),
        el("p", { class: "facts" }, `${spec.key} · default ${valueWords(spec, spec.default)}${paper}${spec.source ? ` · ${spec.source}` : ""}`)),
      el("div", { class: "control" }, this.control.node, this.problem, el("div", { class: "row foot" }, this.state, this.undo, this.reset)));
    this.text = [spec.key, humanName(spec), spec.group_title, spec.meaning, spec.source].join(" ").toLowerCase();
  }

  build() {
    const about = { id: this.id, "aria-describedby": `${this.id}-meaning ${this.id}-problem` };
    const { spec } = this;
    if (spec.kind === "choice") {
      const select = el("select", { ...about, onchange: () => this.change(spec, select.value) }, ...spec.choices.map((choice) => el("option", { value: choice }, choice)));
      return { node: select, inputs: [select], set: (value) => { select.value = value; } };
    }
    if (spec.kind === "bool") {
      const check = el("input", { ...about, type: "checkbox", onchange: () => this.change(spec, check.checked) });
      return { node: el("label", { class: "check" }, check), inputs: [check], set: (value) => { check.checked = value; } };
    }
    const range = { min: spec.low, max: spec.high, step: spec.step ?? "any" };
    const slider = el("input", { ...about, ...range, type: "range" });
    const number = el("input", { ...range, step: "any", type: "number", "aria-label": `${humanName(spec)}, as a number`, "aria-describedby": `${this.id}-problem` });
    slider.addEventListener("input", () => { number.value = slider.value; });
    slider.addEventListener("change", () => this.change(spec, Number(slider.value)));
    number.addEventListener("change", () => this.change(spec, number.value === "" ? null : Number(number.value)));
    const node = el("div", {}, el("div", { class: "row" }, slider, number, el("span", { class: "unit" }, spec.unit)),
      el("div", { class: "ends", "aria-hidden": "true" }, el("span", {}, valueWords(spec, spec.low)), el("span", {}, valueWords(spec, spec.high)), el("span", { class: "unit" }, "")));
    return { node, inputs: [slider, number], number, set: (value) => { slider.value = value; number.value = value; } };
  }

  giveBack(value) {
    this.control.set(value);
    this.change(this.spec, value);
    this.control.inputs[0].focus();
  }

  enable(on) {
    for (const input of this.control.inputs) input.disabled = !on || (this.spec.kind === "choice" && this.spec.choices.length < 2);
    this.mayChange = on;
  }

  /** Show what runs, and what the draft says where it says something (`drafted` undefined: it does not). */
  show(running, drafted, problem) {
    const { spec } = this;
    this.running = running;
    const busy = this.control.inputs.some((input) => input === document.activeElement || input.matches(":active"));
    const value = drafted === undefined ? running : drafted;
    if (!busy || drafted === undefined) if (value !== null) this.control.set(value);
    this.node.classList.toggle("changed", running !== spec.default);
    this.node.classList.toggle("drafted", drafted !== undefined);
    this.control.inputs.forEach((input) => input.toggleAttribute("aria-invalid", problem !== ""));
    setText(this.problem, problem);
    setText(this.undo, `Undo: runs ${valueWords(spec, running)}`);
    this.undo.title = "Take it out of the draft";
    this.undo.hidden = drafted === undefined || !this.mayChange;
    this.reset.hidden = value === spec.default || (drafted !== undefined && running === spec.default) || !this.mayChange;
  }

  answer(...what) {
    this.state.replaceChildren(...what);
  }
}
