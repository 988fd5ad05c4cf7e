import { get, post } from "./api.js";
import { $, ago, badge, commandBadge, el, icon, onChange, setText, tableRow } from "./dom.js";
import { doubt, follow, FRESHNESS, freshnessOfDevice } from "./live.js";
import { ready, start } from "./shell.js";
import { attempt } from "./toast.js";

const RECORDINGS_EVERY_MS = 2000;
const TOLD_SHOWN = 8;
const WORDS = { begin_map_walk: "Begin a map walk", end_map_walk: "End the map walk" };
await start();
let device = null;
let wantedDevice = sessionStorage.getItem("device");
let lastShown = null; // what showLive was given last

// ------------------------------------------------------------------------------------------------------------ live
function showLive(data, elapsed_s, linked, doubt_s) {
  lastShown = [data, elapsed_s, linked, doubt_s];
  showDevices(data.devices.map(({ id, name }) => ({ id, name })));
  device = data.devices.find(({ id }) => id === wantedDevice) || data.devices[0] || null;
  const age_s = device && device.age_s !== null ? device.age_s + elapsed_s : null;
  const fresh = device ? freshnessOfDevice(device, age_s, doubt(device.age_uncertainty_s, doubt_s), data.limits) : "lost";
  $("walk").dataset.freshness = fresh;
  showFreshness(device ? FRESHNESS[fresh] : { kind: "", mark: "○", text: "no device" });
  showState(linked);
  showSeen(elapsed_s);
  const asked = (device?.commands ?? []).filter(({ kind }) => kind in WORDS);
  showCommands(asked.slice(-2));
}

const showDevices = onChange((devices) => {
  $("device-select").replaceChildren(...devices.map(({ id, name }) => el("option", { value: id }, name)));
  if (devices.some(({ id }) => id === wantedDevice)) $("device-select").value = wantedDevice;
});

$("device-select").addEventListener("change", () => {
  wantedDevice = $("device-select").value;
  sessionStorage.setItem("device", wantedDevice);
  showLive(...lastShown); // at once: no order goes to the device that was shown before
});

const showFreshness = onChange(({ kind, mark, text }) => {
  $("freshness").className = `badge ${kind}`;
  $("freshness").dataset.mark = mark;
  setText($("freshness"), text);
});

const drawSign = onChange((name) => $("now-sign").replaceChildren(icon(name)));

function showState(linked) {
  const mode = device?.state?.mode ?? "lost";
  const able = Boolean(device?.connected && device?.state && linked);
  const records = mode === "mapping" || (mode === "fault" && device.map_walk.running);
  drawSign(mode === "guiding" ? "walk" : mode);
  $("now").dataset.mode = mode;
  setText($("now-state"), device?.state?.mode_label ?? "Unknown");
  setText($("now-action"), records ? "A map walk is being recorded" : "No map walk is being recorded");
  setText($("now-reason"), device?.state?.mode_sentence ?? "The device has not told yet what it does.");
  $("begin").hidden = records;
  $("end").hidden = !records;
  $("begin").disabled = !able || device.leads_somebody || mode === "off_duty";
  $("end").disabled = !able;
  setText($("hint"), hint(mode, able, records));
}

function hint(mode, able, records) {
  if (!able) return "The device is not connected: a map walk can be begun with its buttons.";
  if (device.leads_somebody) return "Somebody is being led: a map walk can begin once they have arrived, or guidance is stopped.";
  if (mode === "off_duty") return "The device is off duty: whoever wears it puts it on duty with its main button.";
  return records ? "The walk ends here, or with the device’s main button held." : "The walk must be at least a metre long; a loop back to its beginning makes the map better.";
}

const showCommands = onChange((commands) => {
  $("commands").replaceChildren(...commands.map((command) => el("li", {}, commandBadge(command.state),
    el("span", {}, WORDS[command.kind] + (command.refusal ? `: ${command.refusal}` : "")))));
});

const order = (id, what) => attempt(() => post(`/api/devices/${encodeURIComponent(id)}/map-walk/${what}`));
$("begin").addEventListener("click", () => {
  // Who answers means the device that is named, whichever is shown by then; the console refuses where it has gone.
  $("confirm").dataset.device = device.id;
  setText($("confirm-device"), device.name);
  $("confirm").returnValue = "";
  $("confirm").showModal();
});
$("confirm").addEventListener("close", () => { if ($("confirm").returnValue === "yes") order($("confirm").dataset.device, "begin"); });
$("end").addEventListener("click", () => order(device.id, "end"));

// ------------------------------------------------------------------------------------------------------------ seen
function showSeen(elapsed_s) {
  const seen = device?.map_walk.seen ?? null;
  $("seen-section").hidden = seen === null;
  if (seen === null) return;
  showAdvice({ troubles: seen.troubles, running: device.map_walk.running });
  drawSeen([
    ["Recorded", clock(seen.recorded_s), `${seen.frame_count} pictures`],
    ["Places marked", String(seen.place_count), ""],
    ["Loops closed", String(seen.loop_count), ""],
    ["Landmarks in view", String(seen.landmark_count), ""],
    ["Seen too badly for", clock(seen.weak_s), ""],
    ["Looked at", ago(seen.age_s + elapsed_s), ""],
  ]);
  const told = device.events.filter(({ kind }) => kind === "mode" || kind === "sensor").slice(0, TOLD_SHOWN);
  drawTold(told.map(({ text, age_s }) => ({ text, ago: ago(age_s + elapsed_s) })));
}

const showAdvice = onChange(({ troubles, running }) => {
  const now = troubles.length ? troubles.map((text) => badge("warn", "▲", text)) : [badge("good", "●", "The building is seen well.")];
  $("advice").replaceChildren(...(running ? now : [badge("", "○", "The map walk has ended.")]));
});
const drawSeen = onChange((figures) => $("seen").replaceChildren(
  ...figures.map(([term, value, unit]) => el("div", {}, el("dt", {}, term), el("dd", {}, `${value} `, el("small", {}, unit))))));
const drawTold = onChange((told) => $("told").replaceChildren(
  ...told.map(({ text, ago: when }) => el("li", {}, el("time", {}, when), el("div", {}, text)))));

/** "1:05": minutes and seconds. */
function clock(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

// ------------------------------------------------------------------------------------------------------ recordings
const showRecordings = onChange((recordings) => {
  $("no-recordings").hidden = recordings.length > 0;
  $("recordings-wrap").hidden = recordings.length === 0;
  $("recordings").replaceChildren(...recordings.map(recordingRow));
});

function recordingRow(recording) {
  const { name, date, device: sender, complete, kind, map } = recording;
  const building = map.stage === "building";
  const title = el("th", { scope: "row" }, name, el("div", { class: "small quiet" }, [date, kind === "walk" ? "a walk that was led" : ""].filter(Boolean).join(" · ")));
  const again = map.stage === "none" ? "Build a map" : "Build it again";
  const build = el("button", { type: "button", class: "slim", disabled: !complete || building, "aria-label": `${again}: ${name}`,
    onclick: () => attempt(async () => { await post(`/api/recordings/${recording.sha256}/map`); await fetchRecordings(); }) }, again);
  return tableRow(title, el("td", { class: "wide" }, sender), el("td", {}, arrival(recording)), el("td", {}, ...(kind === "recording" ? mapCell(map) : [el("span", { class: "quiet" }, "–")])),
    el("td", { class: "actions" }, kind === "recording" ? build : ""));
}

function arrival({ complete, have_bytes, size_bytes }) {
  const size = `${(size_bytes / 1e6).toFixed(size_bytes < 1e7 ? 1 : 0)} MB`;
  if (complete) return el("span", {}, badge("good", "✓", "whole"), ` ${size}`);
  return el("span", {}, badge("info", "…", `${Math.floor((100 * have_bytes) / size_bytes)} %`), ` of ${size}`);
}

function mapCell({ stage, percent, site, reason, report }) {
  if (stage === "building") return [badge("info", "…", percent === null ? "building" : `building, ${percent} %`)];
  if (stage === "failed") return [badge("bad", "✕", "not built"), el("div", { class: "small" }, reason)];
  if (stage === "none") return [el("span", { class: "quiet" }, "not built yet")];
  const lost = report.places_lost ? ` Not in it, for nobody knows where they were marked: ${report.places_lost}.` : "";
  const facts = `${Math.round(report.road_m)} m of road, ${report.places} places, ${report.loops_closed} loops, ${Math.round(report.weak_m)} m seen badly.${lost}`;
  return [badge("good", "✓", "built"), el("div", { class: "small" }, facts),
    el("div", { class: "small quiet" }, "A map of its own; open it with ", el("code", {}, `vbr console --site ${site}`))];
}

async function fetchRecordings() {
  showRecordings((await get("/api/recordings")).recordings);
}

await fetchRecordings();
setInterval(() => fetchRecordings().catch(() => {}), RECORDINGS_EVERY_MS);
follow(showLive, () => "devices=all", () => (device ? [device.id] : []));
ready();
