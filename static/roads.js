/* The table of roads, and what is done to one. */

import { $, badge, decimals, el, metres } from "./dom.js";
import { openForm } from "./form.js";
import { roadName } from "./graph.js";
import { placeOnRoad, placeOptions } from "./position.js";
import { whileEditing } from "./presence.js";
import { Table } from "./table.js";

const ORIGINS = { recorded: "recorded by walking", drawn: "drawn by hand" };

export function roadsTable(graph, me, whoIsAt) {
  const point = ([x, y]) => `${decimals(x)}, ${decimals(y)}`;
  const columns = [
    { key: "name", title: "Road", head: true, text: ({ id }) => roadName(id), cell: ({ id }) => [roadName(id), whoIsAt("road", id) && badge("info", "✎", whoIsAt("road", id))].filter(Boolean) },
    { key: "origin", title: "Origin", text: ({ origin }) => ORIGINS[origin] },
    { key: "length", title: "Length", class: "number", text: ({ length_m }) => metres(length_m) },
    { key: "start", title: "Begins at", class: "number wide wider", text: ({ start_m }) => point(start_m) },
    { key: "end", title: "Ends at", class: "number wide wider", text: ({ end_m }) => point(end_m) },
    { key: "actions", title: "Actions", class: "actions", plain: true, cell: (road) => (me.mayEdit ? actions(graph, road) : "") },
  ];
  const table = new Table({
    place: $("panel-roads"), name: "roads", label: "Roads", columns, key: ({ id }) => id, mark: ({ id }) => whoIsAt("road", id), searchHint: "Road, drawn…",
    empty: [el("p", {}, el("b", {}, "There is no road yet.")), el("p", {}, "Record a map walk with the glasses, or draw a road by hand.")],
  });
  $("draw-road").addEventListener("click", () => draw(graph));
  return { show: ({ roads }) => table.show(roads) };
}

function actions(graph, road) {
  const act = (what, does, label, extra = "") => el("button", {
    type: "button", class: `plain slim ${extra}`, "data-key": `${what}-${road.id}`, "aria-label": `${label} ${roadName(road.id)}`,
    onclick: () => does(graph, graph.data.roads.find(({ id }) => id === road.id) ?? road),
  }, what);
  return [act("Trim…", trim, "Trim"), act("Smooth…", smooth, "Smooth"), act("Split…", split, "Split"), act("Join…", join, "Join"),
    act("Delete", (_, now) => graph.remove({ edit: "delete_road", road_id: now.id }, roadName(now.id)), "Delete", "danger")];
}

function edit(graph, road, form, editOf) {
  const base = graph.data.version;
  return whileEditing("road", road.id, () => openForm({
    ...form, lead: form.lead ?? `${roadName(road.id)} is ${road.length_m.toFixed(2)} m long. Places and connections on it follow; where one would lose its road, the edit is refused.`,
    submit: async (values) => graph.edit({ road_id: road.id, ...(await editOf(values)) }, base),
  }));
}

const along = (road, name, label, value) => ({ name, label, type: "number", required: true, min: 0, max: Number(road.length_m.toFixed(2)), value });
const point = async (road, distance_m) => {
  const { x_m, y_m } = await placeOnRoad(road.id, distance_m);
  return [x_m, y_m];
};

function trim(graph, road) {
  return edit(graph, road, {
    title: `Trim ${roadName(road.id)}`, submitText: "Trim",
    fields: [along(road, "start", "Keep from (metres from its beginning)", 0), along(road, "end", "to (metres from its beginning)", Math.floor(100 * road.length_m) / 100)],
  }, async ({ start, end }) => ({ edit: "trim_road", start_m: await point(road, start), end_m: await point(road, end) }));
}

function smooth(graph, road) {
  return edit(graph, road, {
    title: `Smooth ${roadName(road.id)}`, submitText: "Smooth",
    fields: [{ name: "window_m", label: "Over how many metres", type: "number", required: true, min: 0.2, max: 5, value: 1, hint: "The sway of whoever walked is taken out; the ends stay." }],
  }, ({ window_m }) => ({ edit: "smooth_road", window_m }));
}

function split(graph, road) {
  return edit(graph, road, {
    title: `Split ${roadName(road.id)}`, submitText: "Split", fields: [along(road, "distance_m", "Metres from its beginning", (road.length_m / 2).toFixed(2))],
  }, async ({ distance_m }) => ({ edit: "split_road", place_m: await point(road, distance_m) }));
}

function join(graph, road) {
  const others = graph.data.roads.filter(({ id }) => id !== road.id).map(({ id, length_m }) => [id, `${roadName(id)}, ${metres(length_m)}`]);
  return edit(graph, road, {
    title: `Join ${roadName(road.id)} with another road`, submitText: "Join", lead: "They are joined by the ends that are nearest to each other, where these are at most 2 m apart.",
    fields: [{ name: "other_id", label: "The other road", type: "select", required: true, options: [["", "Choose…"], ...others] }],
  }, ({ other_id }) => ({ edit: "join_roads", other_id }));
}

function draw(graph) {
  const base = graph.data.version;
  const places = placeOptions(graph.data.pois);
  const by = (...which) => ({ way }) => which.includes(way);
  return whileEditing(null, "", () => openForm({
    title: "Draw a road", submitText: "Draw it", wide: true,
    lead: "Nobody has walked what is drawn: it is shown as such. An end that comes near a road begins on it.",
    fields: [
      { name: "way", label: "How", type: "select", options: [["places", "From place to place"], ["points", "By coordinates"]], value: places.length > 2 ? "places" : "points" },
      { name: "from_id", label: "From", type: "select", required: true, options: places, shown: by("places") },
      { name: "to_id", label: "To", type: "select", required: true, options: places, shown: by("places") },
      { name: "via", label: "By way of (one point a line: x, y)", type: "textarea", hint: "May stay empty: then the line is straight.", shown: by("places") },
      { name: "points", label: "Points (one a line: x, y)", type: "textarea", required: true, placeholder: "0, 0\n3.5, 0", shown: by("points") },
    ],
    submit: (values) => graph.edit({ edit: "draw_road", points_m: pointsOf(graph, values) }, base),
  }));
}

function pointsOf(graph, { way, from_id, to_id, via, points }) {
  if (way === "points") return linesOf(points);
  const at = (id) => { const { x_m, y_m } = graph.poi(id); return [x_m, y_m]; };
  return [at(from_id), ...linesOf(via), at(to_id)];
}

function linesOf(text) {
  return text.split("\n").filter((line) => line.trim()).map((line, index) => {
    const numbers = line.trim().split(/[\s,;]+/).map(Number);
    if (numbers.length !== 2 || numbers.some((number) => !Number.isFinite(number))) throw new Error(`Point ${index + 1} is not two numbers: write it as “3.5, 0”.`);
    return numbers;
  });
}
