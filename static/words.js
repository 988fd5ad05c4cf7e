/* Fields of places, connections and roads as people read them, for conflicts and differences. */

import { decimals } from "./dom.js";
import { KIND_NAMES, roadName } from "./graph.js";

const FIELDS = {
  name: "Name", kind: "Kind", spoken_name: "Spoken as", notes: "Notes", x_m: "x", y_m: "y", on_road: "On the road", a: "From", b: "To",
  length_m: "Length", one_way: "One way", closed: "Closed", cost_multiplier: "Cost", width_m: "Width", caution_side: "Caution",
  path_m: "Line", points_m: "Line", origin: "Origin",
};
const SIDES = { none: "none", left: "on the left", right: "on the right", both: "on both sides" };
const WHAT = { poi: "place", edge: "connection", road: "road" };

export const fieldName = (field) => FIELDS[field] ?? field.replaceAll("_", " ");

/** A value as people read it; `nameOf` gives the name of a place. */
export function valueWords(field, value, nameOf = (id) => id) {
  if (value === undefined) return "–";
  if (field === "path_m" || field === "points_m") return "another course";
  if (value === null || value === "") return field === "spoken_name" ? "like the name" : "not given";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (field === "kind") return KIND_NAMES[value] ?? value;
  if (field === "caution_side") return SIDES[value] ?? value;
  if (field === "a" || field === "b") return nameOf(value);
  if (field === "cost_multiplier") return `× ${value}`;
  if (field.endsWith("_m")) return `${decimals(Number(value))} m`;
  return String(value);
}

/** "Connection Hall – Bar". */
export function thingName(kind, name) {
  if (kind === "road") return name;
  const what = WHAT[kind] ?? kind;
  return `${what[0].toUpperCase()}${what.slice(1)} ${name}`;
}

/** The name of a thing of the draft: what somebody edits. */
export function nameOfThing(graph, [kind, id]) {
  if (kind === "poi") return graph.nameOf(id);
  if (kind === "road") return roadName(id);
  const edge = graph.data?.edges.find((one) => one.id === id);
  return edge ? graph.edgeName(edge) : "a connection";
}
