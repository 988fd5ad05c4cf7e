/* The floor plan with marks on it: the console's picture where it makes one, else the places and connections as a drawing. */

import { decimals, el, setText } from "./dom.js";

const SVG = "http://www.w3.org/2000/svg";
const DARK = matchMedia("(prefers-color-scheme: dark)");
const MARGIN_M = 2;
const BESIDE_M = 2;
const ASK_AGAIN_MS = 2000;

function svg(tag, properties, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) if (value !== undefined && value !== null) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/** A plan in `place`; `marks` are {number, x_m, y_m, label, kind}. `show(marks)` draws them, `point(number)` shows one as the chosen one. */
export class Plan {
  constructor(place, graph, caption) {
    this.graph = graph;
    this.marks = [];
    this.picture = null;
    this.caption = el("figcaption", { class: "small quiet" });
    this.figure = el("figure", { class: "plan" });
    this.captionWords = caption;
    place.replaceChildren(this.figure, this.caption);
    DARK.addEventListener("change", () => this.fetch());
  }

  /** Get the picture anew, as when the draft has changed. */
  async fetch() {
    const answer = await fetch(`/api/floor-plan.png?theme=${DARK.matches ? "dark" : "light"}`, { cache: "no-store" }).catch(() => null);
    const lies = (name) => Number(answer.headers.get(name) ?? NaN);
    // The map is being measured: the picture is there in a moment.
    clearTimeout(this.timer);
    if (answer?.status === 409) this.timer = setTimeout(() => this.fetch(), ASK_AGAIN_MS);
    if (this.picture) URL.revokeObjectURL(this.picture.url);
    this.picture = null;
    if (answer?.ok) {
      const [left, top, step] = ["x-left-metres", "x-top-metres", "x-metres-per-pixel"].map(lies);
      const url = URL.createObjectURL(await answer.blob());
      if ([left, top, step].every(Number.isFinite)) {
        const size = await sizeOf(url);
        this.picture = { url, box: [left, -top, size.width * step, size.height * step] };
      } else URL.revokeObjectURL(url);
    }
    this.draw();
  }

  show(marks) {
    this.marks = marks;
    this.draw();
  }

  /** Show one of the marks as the chosen one. */
  point(number) {
    for (const node of this.figure.querySelectorAll("[data-mark]")) node.classList.toggle("chosen", node.dataset.mark === String(number));
  }

  draw() {
    const box = this.picture?.box ?? this.bounds();
    const unit = Math.max(box[2], box[3]) / 100;
    const drawing = svg("svg", { viewBox: box.join(" "), role: "img", "aria-label": this.captionWords(this.marks.length) });
    if (this.picture) drawing.append(svg("image", { href: this.picture.url, x: box[0], y: box[1], width: box[2], height: box[3] }));
    else drawing.append(...this.sketch(unit));
    drawing.append(...this.over(unit));
    drawing.append(...this.marks.map((mark) => this.mark(mark, unit)));
    this.figure.replaceChildren(drawing);
    setText(this.caption, this.captionWords(this.marks.length));
  }

  /** What lies between the picture and the marks: for plans that show more. */
  over() {
    return [];
  }

  bounds() {
    const spots = [...this.graph.data.pois, ...this.marks, ...this.graph.data.roads.flatMap(({ start_m, end_m }) => [start_m, end_m].map(([x_m, y_m]) => ({ x_m, y_m })))];
    const [xs, ys] = [spots.map(({ x_m }) => x_m), spots.map(({ y_m }) => -y_m)];
    if (spots.length === 0) return [-5, -5, 10, 10];
    const [left, top] = [Math.min(...xs) - MARGIN_M, Math.min(...ys) - MARGIN_M];
    return [left, top, Math.max(...xs) + MARGIN_M - left, Math.max(Math.max(...ys) + MARGIN_M - top, 5)];
  }

  sketch(unit) {
    const at = (id) => this.graph.poi(id);
    const lines = this.graph.data.edges.map(({ a, b, closed }) => svg("line", {
      class: closed ? "closed" : "", x1: at(a).x_m, y1: -at(a).y_m, x2: at(b).x_m, y2: -at(b).y_m, "stroke-width": unit * 0.5, "stroke-dasharray": closed ? `${unit} ${unit}` : null,
    }));
    const dots = this.graph.data.pois.map(({ x_m, y_m }) => svg("circle", { cx: x_m, cy: -y_m, r: unit * 0.8 }));
    const few = this.graph.data.pois.length <= 40 ? this.graph.data.pois : [];
    const names = few.map(({ name, x_m, y_m }, index) => svg("text", { x: x_m, y: -y_m + unit * (index % 2 ? 3 : -1.6), "font-size": unit * 1.6, "text-anchor": "middle" }, name));
    return [svg("g", { class: "sketch" }, ...lines, ...dots, ...names)];
  }

  mark({ number, x_m, y_m, label, kind = "" }, unit) {
    return svg("g", { class: `plan-mark ${kind}`, "data-mark": number }, svg("title", {}, label),
      svg("circle", { cx: x_m, cy: -y_m, r: unit * 1.1, "stroke-width": unit * 0.3 }),
      svg("text", { x: x_m, y: -y_m + unit * 0.45, "font-size": unit * 1.25, "text-anchor": "middle" }, String(number)));
  }
}

function sizeOf(url) {
  return new Promise((resolve, reject) => {
    const image = new Image();
    image.onload = () => resolve({ width: image.naturalWidth, height: image.naturalHeight });
    image.onerror = () => reject(new Error("The floor plan is not a picture."));
    image.src = url;
  });
}

/** "3.0 m from Hall": the place that is nearest to a point; one that people know goes before a junction that lies beside it. */
export function whereWords(graph, x_m, y_m) {
  const places = graph.data.pois.map((poi) => ({ name: poi.name, known: poi.kind !== "junction", away_m: Math.hypot(poi.x_m - x_m, poi.y_m - y_m) }));
  const closest = (some) => some.reduce((best, one) => (best && best.away_m <= one.away_m ? best : one), null);
  const nearest = closest(places.filter(({ known, away_m }) => known && away_m <= BESIDE_M)) ?? closest(places);
  const at = [x_m, y_m].map((value) => decimals(value, 1)).join(", ");
  if (nearest === null) return at;
  return nearest.away_m < 0.5 ? `at ${nearest.name} (${at})` : `${nearest.away_m.toFixed(1)} m from ${nearest.name} (${at})`;
}
