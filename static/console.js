import { AlertList } from "./alerts.js";
import { post } from "./api.js";
import { Actions } from "./actions.js";
import { $, el, icon, onChange, setText } from "./dom.js";
import { Graph, inListOrder, KIND_NAMES } from "./graph.js";
import { History } from "./history.js";
import { undoKeys } from "./keys.js";
import { doubt, follow, freshnessOfDevice, onScreen, showBadge } from "./live.js";
import { refuseTwin } from "./names.js";
import { Plots } from "./plots.js";
import { SceneAge } from "./scene_age.js";
import { showWhatWasAsked } from "./scene.js";
import { ready, start } from "./shell.js";
import { tabs } from "./tabs.js";
import { attempt, toast } from "./toast.js";
import { tourOnFirstVisit } from "./tour.js";
import { TracePanel } from "./trace.js";
import { Walker } from "./walker.js";
import { WatchersPanel } from "./watchers.js";

const me = await start();
const graph = new Graph(showGraph);
const walker = new Walker({ now: $("walker-now"), figures: $("walker-figures"), depth: $("walker-depth"), events: $("walker-events") });
const plots = new Plots($("plots"));
const history = new History();
const actions = new Actions({ mayEdit: me.mayEdit, placeName: (id) => graph.poi(id)?.name ?? id });
const scene = new SceneAge($("scene-part"), $("scene"), $("scene-freshness"));
const asked = new URLSearchParams(location.search).get("device");
let wantedDevice = asked ?? sessionStorage.getItem("device") ?? "";
const watchers = new WatchersPanel($("watchers"), { me: me.name, ask: (why) => attempt(() => post(`/api/devices/${encodeURIComponent(device.id)}/colour`, { why })) });
const trace = new TracePanel($("panel-trace"));
let device = null;
let captureToScreen_s = null;
let renaming = null;

new AlertList($("alerts"), { device: () => device?.id ?? null });
tabs(document.querySelector("[role=tablist]"));
undoKeys(graph);
if (!me.mayEdit) {
  for (const id of ["publish", "undo", "redo"]) $(id).hidden = true;
  setText($("guide-title"), "Speak to the walker");
}
for (const [id, name] of [["undo", "undo"], ["redo", "redo"]]) $(id).prepend(icon(name));

// ------------------------------------------------------------------------------------------------------------ live
function showLive(data, elapsed_s, linked, doubt_s) {
  graph.heard(data);
  showRoster(data.roster.map(({ id, name, connected }) => ({ id, name, connected })));
  const seen = data.devices[0] ?? null;
  if (seen === null && wantedDevice && !asked && data.roster.length) return choose(""); // it was here before the console was started anew
  if (seen && !wantedDevice) wantedDevice = seen.id; // whoever comes now, this one stays
  const age_s = seen && seen.age_s !== null ? seen.age_s + elapsed_s : null;
  const fresh = seen ? freshnessOfDevice(seen, age_s, doubt(seen.age_uncertainty_s, doubt_s), data.limits) : "lost";
  device = seen && { ...seen, capture_to_screen_s: captureToScreen_s };
  for (const part of ["walker-part", "panel"]) $(part).dataset.freshness = fresh;
  showFreshness(fresh, age_s);
  showNobody();
  walker.show(device, { elapsed_s, age_s, fresh, poi: (id) => graph.poi(id) });
  trace.show(device, { elapsed_s, fresh });
  actions.show(device, { fresh, linked, elapsed_s, age_s });
  showPlots(data, elapsed_s);
  for (const [section, part] of [["plots-section", device?.state], ["figures-section", device?.state], ["depth-section", device?.depth_stamp_s]]) $(section).hidden = (part ?? null) === null;
  scene.show(data.limits, link.consoleTime(), device && { fresh, age_s });
  watchers.show(device, { elapsed_s, linked, fresh });
  showVersions({
    draft: data.draft_version, published: data.published_version, undo: data.can_undo, redo: data.can_redo,
    device: device && { name: device.name, runs: device.graph_version, refusal: device.graph_refusal },
  });
  return undefined;
}

function showFreshness(fresh, age_s) {
  if (device) return showBadge($("freshness"), fresh, age_s);
  $("freshness").className = "badge";
  $("freshness").dataset.mark = "○";
  return setText($("freshness"), "no device");
}

function showNobody() {
  $("no-device").hidden = device !== null;
  if (device === null && wantedDevice) setText($("no-device"), `The device ${wantedDevice} has not connected since the console was started. It connects by itself once it is switched on.`);
}

/** The ring is filled with each new state, and with how long it took until that was on the screen. */
function showPlots(data, elapsed_s) {
  const now_s = data.now_s + elapsed_s;
  const state = device?.state;
  if (state) {
    const sample = history.add(device.id, data.now_s - device.age_s, { deviation_m: state.deviation_m, inliers: state.inlier_count, speed_m_s: state.speed_m_s });
    if (sample) measure(sample, device.age_s - data.now_s);
  }
  plots.show(history.samples, now_s, { off_road_m: device?.off_road_m ?? null });
}

/** Measure how old a state is once the browser has drawn it; `offset_s` is what to add to the console's time to have its age. */
function measure(sample, offset_s) {
  onScreen(() => {
    const console_s = link.consoleTime();
    if (console_s === null) return;
    captureToScreen_s = Math.max(0, console_s + offset_s);
    sample.latency_ms = 1000 * captureToScreen_s;
    $("panel").dataset.captureToScreenMs = sample.latency_ms.toFixed(1);
  });
}

// -------------------------------------------------------------------------------------------------- which device
const showRoster = onChange((roster) => {
  const names = new Map(roster.map(({ id, name }) => [id, roster.filter((other) => other.name === name).length > 1 ? `${name} (${id})` : name]));
  const several = roster.length > 1 || Boolean(wantedDevice && roster.length && !names.has(wantedDevice));
  $("device-select").hidden = !several;
  $("device-name").hidden = several;
  setText($("device-name"), roster[0]?.name ?? "No device yet");
  const options = roster.map(({ id, connected }) => el("option", { value: id }, connected ? names.get(id) : `${names.get(id)}, away`));
  if (several && !names.has(wantedDevice)) options.unshift(el("option", { value: wantedDevice }, wantedDevice || "Choose a walker…"));
  $("device-select").replaceChildren(...options);
  $("device-select").value = wantedDevice;
});

$("device-select").addEventListener("change", () => {
  choose($("device-select").value);
  sessionStorage.setItem("device", wantedDevice);
});

/** Show another device, here and in the scene; "" lets the console choose. Nothing of the last one stays on the screen. */
function choose(id) {
  wantedDevice = id;
  device = null;
  captureToScreen_s = null;
  actions.show(null, { fresh: "lost", linked: false, elapsed_s: 0, age_s: null });
  walker.show(null, { elapsed_s: 0, age_s: null, fresh: "lost", poi: () => null });
  link.again();
  tellScene();
}

function tellScene() {
  if (wantedDevice) post("/api/view", { follow: wantedDevice }).catch(() => {}); // not connected yet: the scene shows nobody
}

for (const [button, camera] of [["follow-walker", "walker"], ["whole-floor", "overview"]]) {
  $(button).addEventListener("click", () => attempt(async () => {
    const { scenes } = await post("/api/view", { camera });
    if (!scenes) throw new Error("The scene is still loading: try again in a moment.");
  }));
}

// ---------------------------------------------------------------------------------------------------------- places
function showGraph(data) {
  actions.showDestinations(data.destinations);
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
const link = follow(showLive, () => `devices=one&device=${encodeURIComponent(wantedDevice)}`, () => (device ? [device.id] : []));
if (asked) sessionStorage.setItem("device", asked);
tellScene();

ready();
tourOnFirstVisit(me);
showWhatWasAsked();
