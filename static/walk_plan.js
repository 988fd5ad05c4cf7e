/* The plan of the building with past walks on it: road, route, trail by deviation, the walker, and what happened where. */

import { el } from "./dom.js";
import { Plan } from "./plan.js";
import { svg } from "./walk_words.js";

/** Layers over the map: a word, and whether they are drawn at first. */
const LAYERS = {
  deviation: { words: "Deviation along the road", on: true },
  stops: { words: "Stops", on: true },
  weak: { words: "Position weak", on: true },
  disagreement: { words: "Sonar and camera disagree", on: true },
  obstacles: { words: "Something in the way", on: false },
};
/** Deviations (m) up to which a colour goes; farther off is the last. Each is also wider than the one before. */
const STEPS_M = [0.15, 0.3, 0.6];
const STEP_WORDS = ["up to 0.15 m", "up to 0.3 m", "up to 0.6 m", "more"];
const stepOf = (deviation_m) => (deviation_m === null ? "none" : STEPS_M.filter((limit_m) => deviation_m > limit_m).length);

export class WalkPlan extends Plan {
  /** `layersRoot` takes the switches of the layers, and their legend. */
  constructor(root, layersRoot, graph, caption, name) {
    super(root, graph, () => caption);
    this.layers = null;
    this.walk = null;
    this.on = new Map(Object.entries(LAYERS).map(([key, { on }]) => [key, on]));
    layersRoot.append(...Object.entries(LAYERS).map(([key, { words, on }]) => {
      const box = el("input", { type: "checkbox", id: `${name}-${key}`, checked: on, onchange: () => { this.on.set(key, box.checked); this.draw(); } });
      return el("label", { class: `check layer-key layer-${key}` }, box, words);
    }), el("ul", { class: "steps-legend", "aria-label": "Deviation" }, ...STEP_WORDS.map((words, step) => el("li", { class: `step-${step}` }, words))));
  }

  showLayers(layers) {
    this.layers = layers;
    this.draw();
  }

  showWalk(walk) {
    this.walk = walk;
    this.draw();
  }

  /** Put the walker where they were: without drawing the rest anew. */
  place(pose, fresh = true) {
    this.pose = pose;
    if (!this.walker) return;
    this.walker.setAttribute("visibility", pose ? "visible" : "hidden");
    if (pose) this.walker.setAttribute("transform", `translate(${pose[0]} ${-pose[1]}) rotate(${(-pose[3] * 180) / Math.PI}) scale(${this.unit * 1.6})`);
    this.walker.classList.toggle("unsure", !fresh);
  }

  bounds() {
    const road = (this.walk?.roads ?? []).flat().map(([x_m, y_m]) => ({ x_m, y_m }));
    const cells = Object.values(this.layers ?? {}).flat().map(([x_m, y_m]) => ({ x_m, y_m }));
    const places = this.walk?.places ?? [];
    this.marks = [...road, ...cells, ...places];
    const box = super.bounds();
    this.marks = [];
    return box;
  }

  over(unit) {
    this.unit = unit;
    const parts = [];
    if (this.walk) parts.push(...this.drawWalk(unit));
    if (this.layers) parts.push(...this.drawLayers(unit));
    if (this.walk) {
      this.walker = svg("path", { class: "plan-walker", d: "M1.3 0-.9.9-.4 0-.9-.9z", "stroke-width": 0.15 });
      this.place(this.pose ?? null);
      parts.push(this.walker);
    }
    return parts;
  }

  drawWalk(unit) {
    const line = (points, name, width) => svg("polyline", { class: name, points: points.map(([x_m, y_m]) => `${x_m},${-y_m}`).join(" "), "stroke-width": width });
    const roads = this.walk.roads.map((points) => line(points, "plan-road", unit * 0.35));
    const routes = this.walk.routes.map(({ points_m }) => line(points_m, "plan-route", unit * 0.7));
    const trail = pieces(this.walk.trail).map(({ step, points }) => line(points, `plan-trail step-${step}`, unit * (0.35 + 0.12 * (step === "none" ? 0 : step))));
    const names = this.picture ? [] : this.walk.places.map(({ name, x_m, y_m }) => svg("text", { class: "plan-name", x: x_m, y: -y_m - unit, "font-size": unit * 1.6, "text-anchor": "middle" }, name));
    return [svg("g", { class: "plan-lines" }, ...roads, ...routes, ...trail), ...names];
  }

  drawLayers(unit) {
    const drawn = {
      deviation: ([x, y, mean, max, count]) => svg("rect", { class: `step-${stepOf(mean)}`, x: x - 0.22, y: -y - 0.22, width: 0.44, height: 0.44 }, svg("title", {}, `${mean.toFixed(2)} m in the mean, ${max.toFixed(2)} m at most, over ${count} cycles`)),
      weak: ([x, y, seconds]) => svg("path", { d: "M0-.3 .3 0 0 .3-.3 0z", transform: `translate(${x} ${-y})` }, svg("title", {}, `Position weak for ${seconds.toFixed(1)} s`)),
      disagreement: ([x, y, seconds]) => svg("path", { d: "M-.35-.28H.35L0 .35z", transform: `translate(${x} ${-y})` }, svg("title", {}, `Sonar and camera disagreed for ${seconds.toFixed(1)} s`)),
      obstacles: ([x, y, seconds]) => svg("circle", { cx: x, cy: -y, r: Math.min(0.5, 0.12 + 0.06 * Math.sqrt(seconds)) }, svg("title", {}, `Something in the way for ${seconds.toFixed(1)} s`)),
      stops: ([x, y, seconds, why]) => svg("path", { d: "M-.8-.8H.8V.8H-.8z", transform: `translate(${x} ${-y}) scale(${unit * Math.min(1.6, 0.5 + 0.1 * Math.sqrt(seconds))})` }, svg("title", {}, `Stopped for ${seconds.toFixed(1)} s: ${why}`)),
    };
    return Object.entries(drawn).filter(([key]) => this.on.get(key)).map(([key, draw]) => svg("g", { class: `plan-layer layer-${key}` }, ...this.layers[key].map(draw)));
  }
}

/** The trail as pieces of one colour each; a leap (the position was lost) is no line. */
function pieces(trail) {
  const found = [];
  let last = null;
  for (const [, x_m, y_m, deviation_m] of trail) {
    const step = stepOf(deviation_m);
    const leap = last && Math.hypot(x_m - last[0], y_m - last[1]) > 1;
    if (!last || leap || step !== found[found.length - 1].step) found.push({ step, points: last && !leap ? [last] : [] });
    found[found.length - 1].points.push([x_m, y_m]);
    last = [x_m, y_m];
  }
  return found;
}
