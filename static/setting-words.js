/* Settings in words: names, values, what differs, and which are out of range or order. */

import { el } from "./dom.js";

export function humanName({ name, unit }) {
  const text = (unit ? name.replace(/_[a-z]+$/, "") : name).replaceAll("_", " ");
  return text.charAt(0).toUpperCase() + text.slice(1);
}

export function valueWords(spec, value) {
  if (spec.kind === "bool") return value ? "yes" : "no";
  return `${value}${spec.unit ? ` ${spec.unit}` : ""}`;
}

/** What differs between two sets of values, in the order of the settings; what only one of them has is left out. */
export function differences(specs, from, to) {
  return specs.filter(({ key }) => key in from && key in to && from[key] !== to[key]).map((spec) => ({ spec, from: from[spec.key], to: to[spec.key] }));
}

/** A table of what differs. */
export function differenceTable(found, fromTitle, toTitle) {
  const head = ["Setting", fromTitle, toTitle].map((title) => el("th", { scope: "col" }, title));
  return el("div", { class: "table-wrap", role: "region", tabindex: 0, "aria-label": `${fromTitle}, ${toTitle}` }, el("table", { "aria-label": `${fromTitle}, ${toTitle}` }, el("thead", {}, el("tr", {}, ...head)),
    el("tbody", {}, ...found.map(({ spec, from, to }) => el("tr", {},
      el("th", { scope: "row" }, `${spec.group_title}: ${humanName(spec)}`, spec.safety ? el("span", { class: "badge warn", "data-mark": "▲" }, "safety") : null),
      el("td", { class: "number-cell" }, valueWords(spec, from)), el("td", { class: "number-cell" }, valueWords(spec, to)))))));
}

/** What is wrong with a value by itself; empty where nothing is. */
export function rangeProblem(spec, value) {
  const sentence = `${spec.range.charAt(0).toUpperCase()}${spec.range.slice(1)}.`;
  if (spec.kind === "choice") return spec.choices.includes(value) ? "" : sentence;
  if (spec.kind === "bool") return typeof value === "boolean" ? "" : sentence;
  const fits = typeof value === "number" && Number.isFinite(value) && value >= spec.low && value <= spec.high && (spec.kind !== "int" || Number.isInteger(value));
  return fits ? "" : sentence;
}

/** Which pairs of related settings are out of order, as {keys, sentence}; the console checks the same table again. */
export function orderProblems(orders, specsByKey, values) {
  return orders.filter(({ lower, upper, may_equal }) => !(values[lower] < values[upper] || (may_equal && values[lower] === values[upper])))
    .map(({ lower, upper, why, may_equal }) => ({
      keys: [lower, upper],
      sentence: `${humanName(specsByKey.get(lower))} must ${may_equal ? "not be more than" : "be less than"} ${humanName(specsByKey.get(upper)).toLowerCase()} (${specsByKey.get(upper).group_title.toLowerCase()}): ${why}.`,
    }));
}
