/* The table of connections, and what is done to one. */

import { post } from "./api.js";
import { $, badge, el, metres, setText } from "./dom.js";
import { openForm } from "./form.js";
import { KIND_NAMES } from "./graph.js";
import { refuseTwin } from "./names.js";
import { placeOptions, placeTowards } from "./position.js";
import { whileEditing } from "./presence.js";
import { Table } from "./table.js";
import { attempt } from "./toast.js";
import { valueWords } from "./words.js";

const SIDES = [["none", "Nothing"], ["left", "On the left"], ["right", "On the right"], ["both", "On both sides"]];
const OTHER_SIDE = { none: "none", both: "both", left: "right", right: "left" };

export function connectionsTable(graph, me, whoIsAt) {
  const columns = [
    { key: "from", title: "From", head: true, text: ({ a }) => graph.nameOf(a), cell: (edge) => [graph.nameOf(edge.a), whoIsAt("edge", edge.id) && badge("info", "✎", whoIsAt("edge", edge.id))].filter(Boolean) },
    { key: "to", title: "To", text: ({ b }) => graph.nameOf(b) },
    { key: "length", title: "Length", class: "number", text: ({ length_m }) => metres(length_m) },
    { key: "direction", title: "Direction", class: "wide", text: ({ one_way }) => (one_way ? "→ one way" : "↔ both ways") },
    { key: "cost", title: "Cost", class: "number wide wider", text: ({ cost_multiplier }) => `× ${cost_multiplier}` },
    { key: "width", title: "Width", class: "number wide wider", text: ({ width_m }) => (width_m === null ? "–" : metres(width_m)) },
    { key: "caution", title: "Caution", class: "wide wider", text: ({ caution_side }) => (caution_side === "none" ? "–" : valueWords("caution_side", caution_side)) },
    { key: "closed", title: "Closed", text: ({ closed }) => (closed ? "closed" : "open"), cell: (edge) => closedBox(graph, me, edge) },
    { key: "actions", title: "Actions", class: "actions", plain: true, cell: (edge) => (me.mayEdit ? actions(graph, edge) : "") },
  ];
  const table = new Table({
    place: $("panel-connections"), name: "edges", label: "Connections", columns, key: ({ id }) => id, searchHint: "Place, closed, one way…",
    mark: (edge) => [graph.nameOf(edge.a), graph.nameOf(edge.b), whoIsAt("edge", edge.id)],
    empty: [el("p", {}, el("b", {}, "No two places are connected yet, so nobody can be guided anywhere.")), el("p", {}, me.mayEdit ? "“Propose connections” makes the whole graph at once, from the order of the places along the road." : "An editor connects them.")],
  });
  $("add-edge").addEventListener("click", () => connect(graph));
  $("propose").addEventListener("click", () => propose(graph));
  return { show: ({ edges }) => table.show(edges) };
}

const wayOf = (graph, { a, b }) => `${graph.nameOf(a)} to ${graph.nameOf(b)}`;

function closedBox(graph, me, edge) {
  const box = el("input", {
    type: "checkbox", "data-key": `closed-${edge.id}`, checked: edge.closed, disabled: !me.mayEdit, "aria-label": `Closed: ${wayOf(graph, edge)}`,
    onchange: async () => {
      if (!(await attempt(() => graph.edit({ edit: "set_edge", edge_id: edge.id, closed: box.checked })))) box.checked = edge.closed;
    },
  });
  return el("label", { class: "check inline" }, box, el("span", { "aria-hidden": "true" }, edge.closed ? "closed" : "open"));
}

function actions(graph, edge) {
  const act = (what, does, label, extra = "") => el("button", {
    type: "button", class: `plain slim ${extra}`, "data-key": `${what}-${edge.id}`, "aria-label": `${label} ${wayOf(graph, edge)}`, onclick: () => does(graph, current(graph, edge)),
  }, what);
  return [act("Change…", change, "Change the connection"), act("Split…", split, "Split the connection"),
    act("Delete", (_, now) => graph.remove({ edit: "delete_edge", edge_id: now.id }, `The connection ${graph.edgeName(now)}`), "Delete the connection", "danger")];
}

const current = (graph, edge) => graph.data.edges.find(({ id }) => id === edge.id) ?? edge;

function change(graph, edge) {
  const base = graph.data.version;
  const [a, b] = [graph.nameOf(edge.a), graph.nameOf(edge.b)];
  return whileEditing("edge", edge.id, () => openForm({
    title: `${a} – ${b}`, lead: `${metres(edge.length_m)} along the road.`,
    fields: [
      { name: "direction", label: "Direction", type: "select", options: [["both", "Both ways"], ["there", `Only from ${a} to ${b}`], ["back", `Only from ${b} to ${a}`]], value: edge.one_way ? "there" : "both" },
      { name: "closed", label: "Closed: nobody is led here", type: "check", value: edge.closed },
      { name: "cost_multiplier", label: "Cost", type: "number", required: true, min: 1, max: 100, value: edge.cost_multiplier, hint: "2 means: as unwelcome as a way of twice the length." },
      { name: "width_m", label: "Width (metres)", type: "number", min: 0, max: 50, value: edge.width_m ?? "", hint: "Free width of the passage, where somebody has measured it." },
      { name: "caution_side", label: `Caution, walked from ${a} to ${b}`, type: "select", options: SIDES, value: edge.caution_side, hint: "An open stairwell, a row of doors." },
    ],
    submit: (values) => graph.edit({ edit: "set_edge", edge_id: edge.id, ...settingsOf(values) }, base),
  }));
}

function settingsOf({ direction, closed, cost_multiplier, width_m, caution_side }) {
  const turned = direction === "back";
  // Where the connection is turned around, its left is the other side.
  return { one_way: direction !== "both", turned, closed, cost_multiplier, width_m: width_m ?? 0, caution_side: turned ? OTHER_SIDE[caution_side] : caution_side };
}

function split(graph, edge) {
  const base = graph.data.version;
  const a = graph.nameOf(edge.a);
  return whileEditing("edge", edge.id, () => openForm({
    title: `A place on ${graph.edgeName(edge)}`, submitText: "Split here", lead: `The connection is ${edge.length_m.toFixed(2)} m long; it becomes two.`,
    fields: [
      { name: "name", label: "Name of the new place", required: true, maxlength: 80 },
      { name: "kind", label: "Kind", type: "select", options: Object.entries(KIND_NAMES), value: "junction" },
      { name: "distance_m", label: `Metres from ${a}`, type: "number", required: true, min: 0, max: Number(edge.length_m.toFixed(2)), value: (edge.length_m / 2).toFixed(2) },
    ],
    submit: async ({ name, kind, distance_m }) => {
      await refuseTwin(graph, name);
      return graph.edit({ edit: "split_edge", edge_id: edge.id, name, kind, ...(await placeTowards(edge.a, edge.b, distance_m)) }, base);
    },
  }));
}

function connect(graph) {
  const base = graph.data.version;
  const options = placeOptions(graph.data.pois.filter(({ on_road }) => on_road));
  const preview = el("p", { class: "note", role: "status", hidden: true });
  let shown = "";
  const onInput = async ({ a, b }) => {
    if (!a || !b || shown === `${a} ${b}`) return;
    shown = `${a} ${b}`;
    const { words, bad } = await previewOf(graph, { edit: "add_edge", a, b });
    if (shown !== `${a} ${b}`) return;
    preview.hidden = false;
    preview.className = bad ? "note warn" : "note";
    setText(preview, words);
  };
  return whileEditing(null, "", () => openForm({
    title: "Connect two places", submitText: "Connect", extra: preview, onInput,
    fields: [{ name: "a", label: "From", type: "select", required: true, options }, { name: "b", label: "To", type: "select", required: true, options }],
    submit: ({ a, b }) => graph.edit({ edit: "add_edge", a, b }, base),
  }));
}

async function previewOf(graph, edit) {
  try {
    const { lengths_m } = await post("/api/preview", edit);
    const [length_m] = Object.values(lengths_m);
    return { words: `${graph.nameOf(edit.a)} and ${graph.nameOf(edit.b)} are ${length_m.toFixed(1)} m apart along the road.`, bad: false };
  } catch (error) {
    return { words: error.message, bad: true };
  }
}

async function propose(graph) {
  let shown = null;
  await attempt(async () => { shown = await proposed(); }, "Looking for neighbours…");
  for (let again = false; shown !== null; again = true) shown = await acceptOrShowAnew(graph, shown, again);
}

const proposed = () => post("/api/preview", { edit: "propose_edges" });

/** Show what is proposed, and make it where it is accepted. Where the draft has changed meanwhile so that something else is
 *  proposed, nothing is made: returns that, to be shown; else null. */
async function acceptOrShowAnew(graph, shown, again) {
  const { changes, lengths_m } = shown;
  const rows = changes.map(({ id, name }) => el("tr", {}, el("th", { scope: "row" }, name), el("td", { class: "number" }, metres(lengths_m[id]))));
  const list = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Connections that are proposed" },
    el("table", {}, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Connection"), el("th", { scope: "col", class: "number" }, "Length"))), el("tbody", {}, ...rows)));
  const many = changes.length === 1 ? "One connection" : `${changes.length} connections`;
  const meanwhile = again ? "The draft has been changed meanwhile, and nothing was accepted yet: this is what is proposed now. " : "";
  let anew = null;
  await openForm({
    title: `${many} proposed`, lead: `${meanwhile}Neighbours along the road that are not connected yet. Nothing is changed before you accept; one undo takes all of them back.`,
    fields: [], extra: list, submitText: "Accept all",
    submit: async () => {
      const now = await proposed();
      if (isSame(now, shown)) await graph.edit({ edit: "propose_edges" }, now.version);
      else anew = now;
    },
  });
  return anew;
}

const isSame = (one, other) => JSON.stringify([one.changes, one.lengths_m]) === JSON.stringify([other.changes, other.lengths_m]);
