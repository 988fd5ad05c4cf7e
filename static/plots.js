/* Small plots of the last two minutes. What was not seen is a gap, never a line across it. */

import { decimals, el, onChange, setText } from "./dom.js";
import { lines, SPAN_S } from "./history.js";

const WIDTH = 240;
const HEIGHT = 56;
const SVG = "http://www.w3.org/2000/svg";
const DRAW_EVERY_MS = 450;
const OLD_S = 5;
const PLOTS = [
  { key: "deviation_m", title: "Off the route", unit: "m", digits: 2, least: 0.5, limit: "off_road_m", limitWords: "off the road" },
  { key: "latency_ms", title: "Capture to screen", unit: "ms", digits: 0, least: 250 },
  { key: "inliers", title: "Landmarks", unit: "", digits: 0, least: 50, most: Math.min },
  { key: "speed_m_s", title: "Speed", unit: "m/s", digits: 1, least: 1 },
];

export class Plots {
  /** `root` is an empty element. */
  constructor(root) {
    this.plots = PLOTS.map((plot) => new Plot(plot));
    root.replaceChildren(...this.plots.map(({ node }) => node));
    this.drawnAt_ms = -Infinity;
  }

  /** Draw what a History holds, as seen at `now_s` (console's clock). `limits` holds what is compared: {off_road_m}. */
  show(samples, now_s, limits) {
    if (performance.now() - this.drawnAt_ms < DRAW_EVERY_MS) return;
    this.drawnAt_ms = performance.now();
    for (const plot of this.plots) plot.show(samples, now_s, limits);
  }
}

class Plot {
  constructor(plot) {
    this.plot = plot;
    this.line = part("path", { class: "plot-line", "vector-effect": "non-scaling-stroke" });
    this.limit = part("path", { class: "plot-limit", "vector-effect": "non-scaling-stroke" });
    const svg = part("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": "true" });
    svg.append(this.limit, this.line);
    this.now = el("b", { class: "number" });
    this.scale = el("span", { class: "plot-scale number", "aria-hidden": "true" });
    this.words = el("p", { class: "visually-hidden" });
    this.node = el("figure", { class: "plot", "data-plot": plot.key },
      el("figcaption", {}, el("span", {}, plot.title), this.now),
      el("div", { class: "plot-area fades" }, svg, this.scale), this.words);
    this.draw = onChange(({ d, limit, now, scale, words }) => {
      this.line.setAttribute("d", d);
      this.limit.setAttribute("d", limit);
      setText(this.now, now);
      setText(this.scale, scale);
      setText(this.words, words);
    });
  }

  show(samples, now_s, limits) {
    const { key, least, limit: limitName, limitWords, unit, digits, most } = this.plot;
    const shown = lines(samples, key, now_s, { most });
    const values = shown.flat().map(([, value]) => value);
    const limit = limits[limitName] ?? null;
    const top = Math.max(least, limit === null ? 0 : 1.25 * limit, ...values.map((value) => 1.1 * value));
    const y = (value) => (HEIGHT - 1 - (value / top) * (HEIGHT - 2)).toFixed(1);
    const x = (before_s) => (WIDTH * (1 - before_s / SPAN_S)).toFixed(1);
    const words = (value) => `${decimals(value, digits)} ${unit}`.trim();
    const last = lastKnown(samples, key, now_s);
    this.draw({
      // A point by itself is a dot: a line of no length with round ends.
      d: shown.map((line) => `M${line.map(([before_s, value]) => `${x(before_s)} ${y(value)}`).join("L")}${line.length === 1 ? "h0.01" : ""}`).join(""),
      limit: limit === null ? "" : `M0 ${y(limit)}H${WIDTH}`,
      now: last === null ? "–" : words(last),
      scale: limit === null ? words(top) : `${limitWords}: ${words(limit)}`,
      words: values.length ? `Two minutes: from ${words(Math.min(...values))} to ${words(Math.max(...values))}.` : "Nothing seen for two minutes.",
    });
  }
}

/** What is known of the present: the newest value, unless that is old. */
function lastKnown(samples, key, now_s) {
  const last = samples.findLast(({ [key]: value }) => value !== undefined);
  return last && now_s - last.at_s < OLD_S ? last[key] : null;
}

function part(name, attributes) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
}
