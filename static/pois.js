import { $, el, icon, metres, setText } from "./dom.js";
import { Graph, KIND_NAMES, undoKeys } from "./graph.js";
import { follow } from "./live.js";
import { ready, start } from "./shell.js";
import { attempt } from "./toast.js";

const me = await start();
let edited = null;
const graph = new Graph(show);

for (const node of document.querySelectorAll(".editing, #undo, #redo, #publish")) node.hidden = !me.mayEdit;
$("undo").prepend(icon("undo"));
$("redo").prepend(icon("redo"));
if (me.mayEdit) undoKeys(graph);
await graph.fetch();
follow((data) => graph.heard(data));

// ------------------------------------------------------------------------------------------------------------ show
function show(data) {
  const focus = document.activeElement?.dataset?.key;
  showVersion(data);
  $("no-places").hidden = data.pois.length > 0;
  $("places-wrap").hidden = data.pois.length === 0;
  $("places").replaceChildren(...byName(data.pois).map(poiRow));
  $("no-edges").hidden = data.edges.length > 0;
  $("edges-wrap").hidden = data.edges.length === 0;
  $("edges").replaceChildren(...byEnds(data.edges).map(edgeRow));
  for (const id of ["edge-a", "edge-b"]) fillEnds($(id), data.pois.filter((poi) => poi.on_road));
  // What had the focus is drawn anew, or gone: the keyboard does not lose its place.
  if (focus) (document.querySelector(`[data-key="${CSS.escape(focus)}"]`) ?? $("add-poi")).focus();
}

function showVersion({ version, published_version, can_undo, can_redo }) {
  const clean = version === published_version;
  setText($("version"), clean
    ? `Version ${version} is published: this is what devices are given.`
    : `This is the draft, version ${version}; devices are given version ${published_version} until you publish.`);
  $("publish").disabled = clean;
  $("undo").disabled = !can_undo;
  $("redo").disabled = !can_redo;
}

function byName(pois) {
  return [...pois].sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
}

function byEnds(edges) {
  const ends = ({ a, b }) => `${graph.poi(a)?.name} ${graph.poi(b)?.name}`;
  return [...edges].sort((one, other) => ends(one).localeCompare(ends(other), undefined, { numeric: true }));
}

function poiRow(poi) {
  const actions = el("td", { class: "actions" });
  if (me.mayEdit) {
    actions.append(
      el("button", { type: "button", class: "plain slim", "data-key": `edit-${poi.id}`, "aria-label": `Edit ${poi.name}`, onclick: () => openPoi(poi) }, "Edit…"),
      el("button", { type: "button", class: "plain danger slim", "data-key": `delete-${poi.id}`, "aria-label": `Delete ${poi.name}`, onclick: () => graph.deletePoi(poi) }, "Delete"),
    );
  }
  return el("tr", {}, el("th", { scope: "row" }, poi.name), el("td", {}, KIND_NAMES[poi.kind]), el("td", { class: "wide" }, poi.spoken_name || el("span", { class: "quiet" }, "like the name")),
    el("td", { class: "number wide" }, poi.x_m.toFixed(2)), el("td", { class: "number wide" }, poi.y_m.toFixed(2)), el("td", { class: "wide" }, poi.on_road ? "yes" : "no, free-standing"), actions);
}

function edgeRow(edge) {
  const [a, b] = [graph.poi(edge.a)?.name ?? edge.a, graph.poi(edge.b)?.name ?? edge.b];
  const way = `${a} to ${b}`;
  const check = (field, label) => el("input", { type: "checkbox", "data-key": `${field}-${edge.id}`, checked: edge[field], disabled: !me.mayEdit, "aria-label": `${label}: ${way}`, onchange: (event) => set(edge, { [field]: event.target.checked }) });
  const cost = el("input", { type: "number", min: 1, max: 100, step: "any", value: edge.cost_multiplier, "data-key": `cost-${edge.id}`, disabled: !me.mayEdit, "aria-label": `Cost factor: ${way}`, onchange: (event) => set(edge, { cost_multiplier: Number(event.target.value) }) });
  const actions = el("td", { class: "actions" });
  if (me.mayEdit) actions.append(el("button", { type: "button", class: "plain danger slim", "data-key": `delete-${edge.id}`, "aria-label": `Delete the way from ${way}`, onclick: () => attempt(() => graph.edit({ edit: "delete_edge", edge_id: edge.id })) }, "Delete"));
  return el("tr", {}, el("th", { scope: "row" }, a), el("td", {}, b), el("td", { class: "number" }, metres(edge.length_m)),
    el("td", { class: "wide" }, check("one_way", "One way")), el("td", {}, check("closed", "Closed")), el("td", { class: "wide" }, cost), actions);
}

async function set(edge, change) {
  if (!(await attempt(() => graph.edit({ edit: "set_edge", edge_id: edge.id, ...change })))) show(graph.data);
}

function fillEnds(select, pois) {
  const before = select.value;
  select.replaceChildren(el("option", { value: "" }, "Choose…"), ...byName(pois).map((poi) => el("option", { value: poi.id }, poi.name)));
  if (pois.some(({ id }) => id === before)) select.value = before;
}

// ------------------------------------------------------------------------------------------------------------ edit
$("undo").addEventListener("click", () => graph.undo());
$("redo").addEventListener("click", () => graph.redo());
$("publish").addEventListener("click", () => graph.publish());
$("propose").addEventListener("click", () => attempt(() => graph.edit({ edit: "propose_edges" })));
$("add-poi").addEventListener("click", () => openPoi(null));
$("poi-cancel").addEventListener("click", () => $("poi-dialog").close());

$("edge-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  setText($("edge-problem"), "");
  try {
    await graph.edit({ edit: "add_edge", a: $("edge-a").value, b: $("edge-b").value });
  } catch (error) {
    setText($("edge-problem"), error.message);
  }
});

function openPoi(poi) {
  edited = poi;
  setText($("poi-dialog-title"), poi ? `Edit ${poi.name}` : "Add a place");
  setText($("poi-problem"), "");
  $("poi-kind").replaceChildren(...graph.data.kinds.map((kind) => el("option", { value: kind }, KIND_NAMES[kind])));
  $("poi-name").value = poi?.name ?? "";
  $("poi-kind").value = poi?.kind ?? "room";
  $("poi-spoken").value = poi?.spoken_name ?? "";
  $("poi-notes").value = poi?.notes ?? "";
  $("poi-x").value = poi ? poi.x_m.toFixed(3) : "";
  $("poi-y").value = poi ? poi.y_m.toFixed(3) : "";
  $("poi-on-road").checked = poi?.on_road ?? true;
  $("poi-dialog").showModal();
  $("poi-name").focus();
}

$("poi-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  setText($("poi-problem"), "");
  try {
    await savePoi();
    $("poi-dialog").close();
  } catch (error) {
    setText($("poi-problem"), error.message);
  }
});

async function savePoi() {
  const names = { name: $("poi-name").value.trim(), kind: $("poi-kind").value, spoken_name: $("poi-spoken").value.trim(), notes: $("poi-notes").value };
  const place = { x_m: Number($("poi-x").value), y_m: Number($("poi-y").value), on_road: $("poi-on-road").checked };
  if (!edited) return graph.edit({ edit: "add_poi", ...names, ...place });
  const moved = Math.abs(place.x_m - edited.x_m) > 5e-4 || Math.abs(place.y_m - edited.y_m) > 5e-4 || place.on_road !== edited.on_road;
  if (moved) await graph.edit({ edit: "move_poi", poi_id: edited.id, ...place });
  return graph.edit({ edit: "update_poi", poi_id: edited.id, ...names });
}

ready();
