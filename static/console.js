import { post } from "./api.js";
import { $, commandBadge, el, icon, onChange, setText } from "./dom.js";
import { Graph, inListOrder, KIND_NAMES } from "./graph.js";
import { undoKeys } from "./keys.js";
import { follow, FRESHNESS, freshnessOf } from "./live.js";
import { refuseTwin } from "./names.js";
import { showWhatWasAsked } from "./scene.js";
import { ready, start } from "./shell.js";
import { tabs } from "./tabs.js";
import { attempt, toast } from "./toast.js";
import { tourOnFirstVisit } from "./tour.js";
import { Walker } from "./walker.js";
import { WatchersPanel } from "./watchers.js";

const me = await start();
const graph = new Graph(showGraph);
const walker = new Walker();
const watchers = new WatchersPanel($("watchers"), { me: me.name, ask: (why) => onDevice("colour", { why }) });
let device = null;
let wantedDevice = sessionStorage.getItem("device");
let renaming = null;

tabs(document.querySelector("[role=tablist]"));
undoKeys(graph);
if (!me.mayEdit) {
  for (const id of ["publish", "undo", "redo", "guide-controls"]) $(id).hidden = true;
  setText($("guide-title"), "Speak to the walker");
}
for (const [id, name] of [["undo", "undo"], ["redo", "redo"]]) $(id).prepend(icon(name));

// ------------------------------------------------------------------------------------------------------------ live
function showLive(data, elapsed_s, linked) {
  graph.heard(data);
  showDevices(data.devices.map(({ id, name }) => ({ id, name })));
  device = data.devices.find(({ id }) => id === wantedDevice) || data.devices[0] || null;
  const age_s = device && device.age_s !== null ? device.age_s + elapsed_s : null;
  const fresh = device ? freshnessOf(age_s, device.age_uncertainty_s, device.connected && linked, data.limits) : "lost";
  $("panel").dataset.freshness = fresh;
  showFreshness(fresh);
  walker.show(device, { elapsed_s, age_s, fresh, poi: (id) => graph.poi(id) });
  watchers.show(device, { elapsed_s, linked });
  showButtons(linked);
  showCommands(device ? device.commands.filter(({ kind }) => kind !== "apply_settings").slice(-3) : []);
  showVersions({
    draft: data.draft_version, published: data.published_version, undo: data.can_undo, redo: data.can_redo,
    device: device && { name: device.name, runs: device.graph_version, refusal: device.graph_refusal },
  });
}

const showDevices = onChange((devices) => {
  const several = devices.length > 1;
  $("device-select").hidden = !several;
  $("device-name").hidden = several;
  setText($("device-name"), devices[0]?.name ?? "No device yet");
  $("device-select").replaceChildren(...devices.map(({ id, name }) => el("option", { value: id }, name)));
  if (wantedDevice && devices.some(({ id }) => id === wantedDevice)) $("device-select").value = wantedDevice;
});

$("device-select").addEventListener("change", () => {
  wantedDevice = $("device-select").value;
  sessionStorage.setItem("device", wantedDevice);
  attempt(() => post("/api/view", { follow: wantedDevice }));
});

const showFreshness = onChange((fresh) => {
  const { kind, mark, text } = FRESHNESS[fresh];
  $("freshness").className = `badge ${device ? kind : ""}`;
  $("freshness").dataset.mark = device ? mark : "○";
  setText($("freshness"), device ? text : "no device");
});

// ----------------------------------------------------------------------------------------------------------- guide
function showButtons(linked) {
  const able = Boolean(device?.connected && linked);
  const mode = device?.state?.mode;
  $("guide").disabled = !(able && me.mayEdit && $("destination").value);
  $("say-send").disabled = $("repeat").disabled = !able;
  $("pause").hidden = mode === "paused";
  $("resume").hidden = mode !== "paused";
  $("pause").disabled = !(able && me.mayEdit && (mode === "guiding" || mode === "lost"));
  $("resume").disabled = !(able && me.mayEdit);
  $("clear").disabled = !(able && me.mayEdit && device?.state?.destination_id && mode !== "arrived");
}

const onDevice = (what, body) => attempt(() => post(`/api/devices/${encodeURIComponent(device.id)}/${what}`, body));

$("guide").addEventListener("click", () => onDevice("destination", { poi_id: $("destination").value }));
$("pause").addEventListener("click", () => onDevice("pause"));
$("resume").addEventListener("click", () => onDevice("resume"));
$("clear").addEventListener("click", () => onDevice("clear"));
$("repeat").addEventListener("click", () => onDevice("repeat"));
$("destination").addEventListener("change", nameGuideButton);
$("say-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const text = $("say").value.trim();
  if (text && (await onDevice("say", { text }))) $("say").value = "";
});

function nameGuideButton() {
  const chosen = $("destination").selectedOptions[0];
  setText($("guide"), chosen?.value ? `Guide to ${chosen.textContent}` : "Guide");
}

const showDestinations = onChange((destinations) => {
  const before = $("destination").value;
  const options = (chosen) => inListOrder(chosen).map(({ id, name }) => el("option", { value: id }, name));
  const junctions = options(destinations.filter(({ kind }) => kind === "junction"));
  $("destination").replaceChildren(
    el("option", { value: "" }, "Choose a place…"), ...options(destinations.filter(({ kind }) => kind !== "junction")),
    ...(junctions.length ? [el("optgroup", { label: "Junctions" }, ...junctions)] : []));
  if (destinations.some(({ id }) => id === before)) $("destination").value = before;
  nameGuideButton();
});

const showCommands = onChange((commands) => {
  $("commands").replaceChildren(...commands.map((command) => {
    const why = command.refusal ? `: ${command.refusal}` : "";
    return el("li", {}, commandBadge(command.state), el("span", {}, commandWords(command) + why));
  }));
});

function commandWords({ kind, detail }) {
  const place = graph.poi(detail)?.name ?? detail;
  return {
    begin_map_walk: "Begin a map walk", end_map_walk: "End the map walk",
    set_destination: `Guide to ${place}`, clear: "Stop guiding", pause: "Pause", resume: "Resume", repeat: "Repeat", ask_colour: "Ask to see pictures", say: `Say “${detail}”`,
  }[kind];
}

// ---------------------------------------------------------------------------------------------------------- places
function showGraph(data) {
  showDestinations(data.destinations);
  showPlaces({ pois: data.pois, edges: data.edges.map(({ a, b }) => [a, b]) });
  const unpublished = data.pois.filter(({ id }) => !data.destinations.some((place) => place.id === id)).length;
  const not = unpublished === 1 ? "One place is" : `${unpublished} places are`;
  const hint = unpublished ? `${not} not published yet: only what is published (tab Places) is offered here.` : "";
  setText($("destination-hint"), hint);
}

const showVersions = onChange(({ draft, published, undo, redo, device: running }) => {
  const clean = draft === published;
  setText($("draft-title"), clean ? `Published: version ${published}` : `Draft: version ${draft}`);
  let detail = clean ? "" : `Version ${published} is published. `;
  if (running?.refusal) detail += `${running.name} refuses it: ${running.refusal}`;
  else if (running) detail += running.runs === published ? `${running.name} runs version ${running.runs}.` : `${running.name} runs version ${running.runs}, and takes ${published} at the next stop.`;
  setText($("draft-detail"), detail);
  $("publish").disabled = clean || !me.mayEdit;
  $("undo").disabled = !undo;
  $("redo").disabled = !redo;
});

$("publish").addEventListener("click", () => graph.publish());
$("undo").addEventListener("click", () => graph.undo());
$("redo").addEventListener("click", () => graph.redo());

const showPlaces = onChange(drawPlaces);

function drawPlaces({ pois, edges }) {
  $("no-places").hidden = pois.length > 0;
  // Somebody is typing a new name: the list is drawn when they are done.
  if (renaming) return;
  $("places").replaceChildren(...inListOrder(pois).map((poi) => placeItem(poi, edges.filter((ends) => ends.includes(poi.id)).length)));
}

function placeItem(poi, ways) {
  const facts = [KIND_NAMES[poi.kind], ways === 0 ? "not joined" : ways === 1 ? "1 way" : `${ways} ways`];
  if (!poi.on_road) facts.push("off the road");
  const button = (name, label, act) => el("button", { type: "button", class: `plain square ${name === "remove" ? "danger" : ""}`, title: label, "aria-label": `${label} ${poi.name}`, onclick: act }, icon(name));
  const item = el("li", {}, el("div", { class: "what" }, el("b", {}, poi.name), el("span", {}, facts.join(" · "))), button("fly", "Fly to", () => fly(poi)));
  if (me.mayEdit) item.append(button("edit", "Rename", () => rename(item, poi)), button("remove", "Delete", () => graph.deletePoi(poi)));
  return item;
}

function fly(poi) {
  return attempt(async () => {
    const { scenes } = await post("/api/view", { fly_to: poi.id });
    if (!scenes) toast("The scene is still loading: try again in a moment.");
  });
}

function rename(item, poi) {
  renaming = poi.id;
  const input = el("input", { value: poi.name, maxlength: 80, required: true, "aria-label": `New name of ${poi.name}` });
  const done = () => { renaming = null; redrawPlaces(); };
  const form = el("form", { onsubmit: async (event) => {
    event.preventDefault();
    const name = input.value.trim();
    const save = async () => {
      await refuseTwin(graph, name, poi);
      await graph.edit({ edit: "update_poi", poi_id: poi.id, name });
    };
    if (await attempt(save)) done();
  } }, input, el("button", { type: "submit", class: "slim" }, "Save"));
  form.addEventListener("keydown", (event) => { if (event.key === "Escape") done(); });
  item.replaceChildren(form);
  input.focus();
  input.select();
}

function redrawPlaces() {
  drawPlaces({ pois: graph.data.pois, edges: graph.data.edges.map(({ a, b }) => [a, b]) });
}

await graph.fetch();
follow(showLive, () => (device ? [device.id] : []));

ready();
if (me.mayEdit) tourOnFirstVisit(me);
showWhatWasAsked();
