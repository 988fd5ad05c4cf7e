/* The timeline of a past walk: marks by colour and shape, the deviation as a curve, and a slider over it all. */

import { el, setText } from "./dom.js";
import { clock, markSign, MARKS, svg } from "./walk_words.js";

const CURVE_HEIGHT = 46;
const LANE_HEIGHT = 14;
const MARK_SIZE = 4.5;

export class Strip {
  /** `seek(at_s)` is called when somebody drags or clicks. */
  constructor(root, seek) {
    this.slider = el("input", { type: "range", min: 0, id: "position", "aria-label": "Instant of the walk", oninput: () => seek(Number(this.slider.value)) });
    this.box = el("div", { class: "strip" });
    this.legend = el("ul", { class: "strip-legend", "aria-label": "Marks" });
    root.replaceChildren(this.box, this.legend);
    new ResizeObserver(() => this.draw()).observe(this.box);
  }

  show(walk) {
    this.walk = walk;
    this.lanes = Object.keys(MARKS).filter((kind) => !MARKS[kind].rare || walk.marks.some((mark) => mark.kind === kind));
    this.height = CURVE_HEIGHT + this.lanes.length * LANE_HEIGHT + 6;
    Object.assign(this.slider, { max: walk.length_s, step: walk.cycle_s, value: 0 });
    const count = (kind) => walk.marks.filter((mark) => mark.kind === kind).length;
    this.legend.replaceChildren(...this.lanes.map((kind) => el("li", {}, markSign(kind), `${MARKS[kind].words}: ${count(kind)}`)), el("li", { class: "curve-key" }, "Curve: distance from the way"));
    this.draw();
  }

  draw() {
    if (!this.walk) return;
    const width = Math.max(200, this.box.clientWidth);
    this.x = (at_s) => 8 + (width - 16) * (at_s / Math.max(this.walk.length_s, 1e-3));
    const drawing = svg("svg", { viewBox: `0 0 ${width} ${this.height}`, width, height: this.height, role: "img", "aria-label": "Timeline of the walk; the list below says the same in words" });
    drawing.append(...this.curve(width), ...this.lanes.flatMap((kind, lane) => this.lane(kind, CURVE_HEIGHT + 6 + (lane + 0.5) * LANE_HEIGHT, width)));
    this.cursor = svg("line", { class: "strip-cursor", y1: 0, y2: this.height });
    drawing.append(this.cursor);
    this.box.replaceChildren(drawing, this.slider);
    this.move(this.at_s ?? 0);
  }

  curve(width) {
    const top_m = Math.max(0.5, ...this.walk.curve.map(([, value]) => value ?? 0));
    const y = (value_m) => CURVE_HEIGHT - (CURVE_HEIGHT - 10) * (value_m / top_m);
    let d = "";
    let drawing = false;
    for (const [at_s, value_m] of this.walk.curve) {
      if (value_m !== null) d += `${drawing ? "L" : "M"}${this.x(at_s).toFixed(1)} ${y(value_m).toFixed(1)}`;
      drawing = value_m !== null;
    }
    return [svg("line", { class: "strip-base", x1: 0, x2: width, y1: CURVE_HEIGHT, y2: CURVE_HEIGHT }), svg("path", { class: "strip-curve", d }),
      svg("text", { class: "strip-scale", x: 8, y: 9 }, `${top_m.toFixed(1)} m`)];
  }

  lane(kind, y, width) {
    const marks = this.walk.marks.filter((mark) => mark.kind === kind);
    return [svg("line", { class: "strip-lane", x1: 0, x2: width, y1: y, y2: y }), ...marks.map((mark) => {
      const x = this.x(mark.at_s);
      const shape = svg("path", { d: MARKS[kind].shape, transform: `translate(${x.toFixed(1)} ${y}) scale(${MARK_SIZE})` });
      const long = mark.length_s > 0 ? [svg("rect", { x, y: y - 2, width: Math.max(1, this.x(mark.at_s + mark.length_s) - x), height: 4 })] : [];
      return svg("g", { class: `mark-${kind}` }, ...long, shape, svg("title", {}, `${clock(mark.at_s)} ${mark.text}`));
    })];
  }

  move(at_s) {
    this.at_s = at_s;
    if (!this.walk) return;
    this.slider.value = at_s;
    this.slider.setAttribute("aria-valuetext", `${clock(at_s)} of ${clock(this.walk.length_s)}`);
    for (const name of ["x1", "x2"]) this.cursor?.setAttribute(name, this.x(at_s).toFixed(1));
  }
}

/** The list that says the same as the strip; `seek(at_s)` goes there. */
export function marksList(root, marks, seek) {
  const shown = marks.filter(({ kind }) => MARKS[kind].stops);
  root.replaceChildren(...shown.map((mark) => {
    const length = mark.length_s >= 0.05 ? `, ${mark.length_s.toFixed(1)} s` : "";
    const go = el("button", { type: "button", class: "plain slim number", onclick: () => seek(mark.at_s) }, clock(mark.at_s));
    return el("li", {}, go, el("div", {}, markSign(mark.kind), ` ${MARKS[mark.kind].words}${length}`, el("span", { class: "kind" }, mark.text)));
  }));
  if (shown.length === 0) root.append(el("li", {}, el("span", { class: "quiet" }, "Nothing: no stop, no weak position, nothing asked for.")));
  return shown;
}

export const sayTime = (node, at_s, length_s) => setText(node, `${clock(at_s, true)} of ${clock(length_s)}`);
