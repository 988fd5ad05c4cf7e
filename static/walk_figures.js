/* The figures of a walk, by leg, and beside those of earlier walks. */

import { decimals, el, setText } from "./dom.js";
import { clock, date, figure } from "./walk_words.js";

export function showFigures(root, figures) {
  const { deviation } = figures;
  root.replaceChildren(...[
    ["Deviation, mean", figure(deviation.mean_m, "m")],
    ["Deviation, maximum", figure(deviation.max_m, "m")],
    ["Deviation, variance", figure(deviation.variance_m2, "m²", 4)],
    ["Time in which somebody was led", clock(figures.seconds)],
    ["Of this standing, told to or not", clock(figures.standing_s)],
    ["Way walked / planned", `${figure(figures.path_m, "m", 1)} / ${figure(figures.route_m, "m", 1)}`],
    ["Told to stop", String(figures.stop_count)],
    ["Position weak", figure(figures.weak_s, "s", 1)],
    ["Off the road", figure(figures.off_road_s, "s", 1)],
    ["Sonar and camera disagreed", figure(figures.disagreement_s, "s", 1)],
  ].map(([term, value]) => el("div", {}, el("dt", {}, term), el("dd", {}, value))));
}

const cells = (values) => values.map((value) => el("td", { class: "number" }, value));
const deviations = ({ mean_m, max_m, variance_m2 }) => [figure(mean_m, "m"), figure(max_m, "m"), figure(variance_m2, "m²", 4)];

export function showLegs(root, legs) {
  root.replaceChildren(...legs.map(({ to, seconds, standing_s, deviation }) => el("tr", {}, el("th", { scope: "row" }, to), ...cells([clock(seconds), clock(standing_s), ...deviations(deviation)]))));
}

export function showCompared(root, words, wrap, compared, id) {
  const lines = compared?.lines ?? [];
  wrap.hidden = lines.length < 2;
  setText(words, comparedWords(compared));
  root.replaceChildren(...lines.toReversed().map(({ walk_id, began_at_s, figures }) => el("tr", { class: walk_id === id ? "this-walk" : null },
    el("th", { scope: "row" }, walk_id === id ? `${date(began_at_s)} (this walk)` : el("a", { href: `/walks?walk=${encodeURIComponent(walk_id)}` }, date(began_at_s))),
    el("td", {}, figures.arrived ? "✓ Yes" : "No"), ...cells([clock(figures.seconds), clock(figures.standing_s), String(figures.stop_count), ...deviations(figures.deviation)]))));
}

function comparedWords(compared) {
  if (!compared || compared.difference === null) return "No earlier walk of this way is here.";
  const { difference, lines, trend_m } = compared;
  const parts = [
    more(difference.mean_m, "m", "in the mean farther from the way", "in the mean nearer to the way"),
    more(difference.seconds, "s", "longer", "shorter", 0), more(difference.stop_count, "stops", "more", "fewer", 1),
  ].filter(Boolean);
  const count = lines.length - 1;
  const trend = trend_m === null ? "" : ` From walk to walk the mean deviation ${trend_m > 0 ? "grows" : "falls"} by ${decimals(Math.abs(trend_m), 3)} m.`;
  return `Beside the mean of ${count === 1 ? "the earlier walk" : `${count} earlier walks`}: ${parts.join(", ") || "the same"}.${trend}`;
}

function more(value, unit, above, below, digits = 2) {
  if (value === null || Number(value.toFixed(digits)) === 0) return "";
  return `${decimals(Math.abs(value), digits)} ${unit} ${value > 0 ? above : below}`;
}
