/* The table of places, and what is done to one. */

import { $, badge, decimals, el, setText } from "./dom.js";
import { openForm } from "./form.js";
import { inListOrder, KIND_NAMES } from "./graph.js";
import { refuseTwin } from "./names.js";
import { placeOptions, placeTowards, positionFields, positionOf } from "./position.js";
import { whileEditing } from "./presence.js";
import { Table } from "./table.js";

const KINDS = Object.entries(KIND_NAMES);
const NUDGES_M = [-1, -0.1, 0.1, 1];

export function placesTable(graph, me, whoIsAt) {
  let degree = new Map();
  const spoken = (poi) => poi.spoken_name || (poi.kind === "junction" ? "passed in silence" : "like the name");
  const columns = [
    { key: "name", title: "Name", head: true, text: ({ name }) => name, cell: (poi) => [poi.name, whoIsAt("poi", poi.id) && badge("info", "✎", whoIsAt("poi", poi.id))].filter(Boolean) },
    { key: "kind", title: "Kind", text: ({ kind }) => KIND_NAMES[kind] },
    { key: "spoken", title: "Spoken as", class: "wide", text: spoken, cell: (poi) => (poi.spoken_name ? poi.spoken_name : el("span", { class: "quiet" }, spoken(poi))) },
    { key: "x", title: "x", class: "number wide wider", text: ({ x_m }) => decimals(x_m) },
    { key: "y", title: "y", class: "number wide wider", text: ({ y_m }) => decimals(y_m) },
    { key: "ways", title: "Connections", class: "wide", text: (poi) => (poi.on_road ? ways(degree.get(poi.id) ?? 0) : "free-standing") },
    { key: "actions", title: "Actions", class: "actions", plain: true, cell: (poi) => (me.mayEdit ? actions(graph, poi) : "") },
  ];
  const table = new Table({
    place: $("panel-places"), name: "places", label: "Places", columns, key: ({ id }) => id, mark: ({ id }) => [whoIsAt("poi", id), degree.get(id)],
    searchHint: "Name, kind…",
    empty: [el("p", {}, el("b", {}, "No place is tagged yet.")), el("p", {}, me.mayEdit ? "“Add a place” asks for its name, kind and position; or press 2 (Tag a place) in the scene, and click on the road." : "An editor tags them.")],
  });
  $("add-poi").addEventListener("click", () => addPlace(graph));
  return {
    show({ pois, edges }) {
      degree = new Map();
      for (const { a, b } of edges) for (const end of [a, b]) degree.set(end, (degree.get(end) ?? 0) + 1);
      table.show(pois);
    },
  };
}

const ways = (count) => (count === 0 ? "none" : String(count));

function actions(graph, poi) {
  const act = (what, does, label = what, extra = "") => el("button", {
    type: "button", class: `plain slim ${extra}`, "data-key": `${what}-${poi.id}`, "aria-label": `${label} ${poi.name}`, onclick: () => does(graph, graph.poi(poi.id) ?? poi),
  }, what);
  return [act("Edit…", editPlace, "Edit"), act("Move…", movePlace, "Move"), act("Merge…", mergePlace, "Merge"),
    act("Delete", (_, current) => graph.deletePoi(current), "Delete", "danger")];
}

function nameFields(poi) {
  return [
    { name: "name", label: "Name", required: true, maxlength: 80, value: poi?.name, span: 3 },
    { name: "kind", label: "Kind", type: "select", options: KINDS, value: poi?.kind ?? "room", span: 3 },
    { name: "spoken_name", label: "Spoken as", maxlength: 80, value: poi?.spoken_name, placeholder: "like the name", hint: "How the walker hears it, where that differs: “Room thirty-three” for “R 33”." },
    { name: "notes", label: "Notes", type: "textarea", maxlength: 2000, value: poi?.notes },
  ];
}

function addPlace(graph) {
  const [name, kind, spoken, notes] = nameFields(null);
  const base = graph.data.version;
  return whileEditing(null, "", () => openForm({
    title: "Add a place", fields: [name, kind, ...positionFields(graph, "between"), spoken, notes], submitText: "Add it", wide: true,
    submit: async (values) => {
      await refuseTwin(graph, values.name);
      return graph.edit({ edit: "add_poi", ...namesOf(values), ...(await positionOf(values)) }, base);
    },
  }));
}

function editPlace(graph, poi) {
  const base = graph.data.version;
  return whileEditing("poi", poi.id, () => openForm({
    title: `Edit ${poi.name}`, wide: true, fields: nameFields(poi),
    submit: async (values) => {
      await refuseTwin(graph, values.name, poi);
      return graph.edit({ edit: "update_poi", poi_id: poi.id, ...changed(namesOf(values), poi) }, base);
    },
  }));
}

const namesOf = ({ name, kind, spoken_name, notes }) => ({ name, kind, spoken_name, notes });
/** Only what was changed is sent: what somebody else does to another field is not undone by the way. */
const changed = (values, before) => Object.fromEntries(Object.entries(values).filter(([key, value]) => value !== before[key]));

function movePlace(graph, poi) {
  let base = graph.data.version;
  const move = async (place) => {
    await graph.edit({ edit: "move_poi", poi_id: poi.id, ...place }, base);
    base = graph.data.version;
  };
  return whileEditing("poi", poi.id, () => openForm({
    title: `Move ${poi.name}`, wide: true, fields: positionFields(graph, poi.on_road ? "between" : "xy", poi), submitText: "Move it",
    lead: poi.on_road ? "Its connections follow it along the road." : "It stands free, off the road.",
    extra: poi.on_road ? nudges(graph, poi, move) : null,
    submit: async (values) => move(await positionOf(values)),
  }));
}

/** Buttons that slide a place along the road, towards a neighbour or away from it. */
function nudges(graph, poi, move) {
  const neighbours = new Set(graph.data.edges.flatMap(({ a, b }) => (a === poi.id ? [b] : b === poi.id ? [a] : [])));
  const others = graph.data.pois.filter(({ id, on_road }) => on_road && id !== poi.id);
  if (others.length === 0) return null;
  const order = [...inListOrder(others.filter(({ id }) => neighbours.has(id))), ...inListOrder(others.filter(({ id }) => !neighbours.has(id)))];
  const towards = el("select", { id: "nudge-towards" }, ...order.map(({ id, name }) => el("option", { value: id }, name)));
  const said = el("p", { class: "small quiet", role: "status" });
  const button = (step_m) => el("button", { type: "button", class: "slim", onclick: () => nudge(step_m) },
    `${Math.abs(step_m)} m ${step_m < 0 ? "away" : "towards"}`);
  const nudge = async (step_m) => {
    try {
      await move({ ...(await placeTowards(poi.id, towards.value, step_m)), on_road: true });
      const now = graph.poi(poi.id);
      setText(said, `${now.name} is now at ${decimals(now.x_m)}, ${decimals(now.y_m)}.`);
    } catch (error) {
      setText(said, error.message);
    }
  };
  return el("fieldset", { class: "stack tight boxed" }, el("legend", {}, "Or slide it along the road, at once"),
    el("div", { class: "field" }, el("label", { for: "nudge-towards" }, "Towards"), towards), el("div", { class: "row" }, ...NUDGES_M.map(button)), said);
}

function mergePlace(graph, poi) {
  const base = graph.data.version;
  const others = graph.data.pois.filter(({ id }) => id !== poi.id);
  return whileEditing("poi", poi.id, () => openForm({
    title: `Merge another place into ${poi.name}`, submitText: "Merge",
    lead: `${poi.name} stays as it is. The other place goes, and its connections lead here.`,
    fields: [{ name: "other_id", label: "Which place goes?", type: "select", required: true, options: placeOptions(others) }],
    submit: ({ other_id }) => graph.edit({ edit: "merge_pois", poi_id: poi.id, other_id }, base),
  }));
}
