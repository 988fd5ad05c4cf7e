/* The page Alerts: what stands now, what there was, how it sounds, and the incidents. */

import { onAlerts } from "./alert-feed.js";
import { MARKS, sound } from "./alert-head.js";
import { AlertList, span } from "./alerts.js";
import { ask, get, inTurn, post } from "./api.js";
import { $, badge, el, onChange, setText } from "./dom.js";
import { openForm, sure } from "./form.js";
import { ready, start } from "./shell.js";
import { attempt } from "./toast.js";

// A phone draws rows as cards: without their roles they would be a table no more.
const ROW = { role: "row" };
const CELL = { role: "cell" };
const HEAD = { role: "rowheader", scope: "row" };
const REFRESH_EVERY_MS = 5000;
const me = await start();
const chosen = () => $("device-select").value || null;
const query = () => (chosen() ? `?device=${encodeURIComponent(chosen())}` : "");
let devices = [];

new AlertList($("active"), { device: chosen, empty: "Nothing needs anybody just now." });
$("device-select").addEventListener("change", () => attempt(refresh));

// ----------------------------------------------------------------------------------------------------------- history
const refresh = inTurn(async () => {
  const [{ recent, devices: known }, { incidents }] = await Promise.all([get(`/api/alerts${query()}`), get(`/api/incidents${query()}`)]);
  devices = known;
  showDevices(known);
  showHistory(recent);
  showIncidents(incidents);
});

const showDevices = onChange((known) => {
  const before = $("device-select").value;
  $("device-select").replaceChildren(el("option", { value: "" }, "All devices"), ...known.map(({ id, name }) => el("option", { value: id }, name)));
  if (known.some(({ id }) => id === before)) $("device-select").value = before;
  $("keep").disabled = !known.some(({ connected }) => connected);
});

const date = (at_s) => new Date(at_s * 1000).toLocaleString();

const showHistory = onChange((recent) => {
  $("no-history").hidden = recent.length > 0;
  $("history-wrap").hidden = recent.length === 0;
  $("history").replaceChildren(...recent.map((alert) => {
    const over = alert.returned_at_s === null ? "still holds" : span(alert.returned_at_s - alert.raised_at_s);
    const seen = alert.acknowledged_after_s === null ? badge("warn", "!", "not yet") : span(alert.acknowledged_after_s);
    return el("tr", ROW, el("td", { ...CELL, class: "when" }, date(alert.raised_at_s)), el("td", CELL, badge(...MARKS[alert.priority], alert.priority)),
      el("th", HEAD, alert.title, el("span", { class: "small quiet alert-what" }, `${alert.sentence}${alert.times > 1 ? ` Came ${alert.times} times.` : ""}`), steps(alert)),
      el("td", { ...CELL, class: "wide" }, over), el("td", CELL, el("span", { class: "narrow-only quiet" }, "Acknowledged after "), seen), el("td", CELL, alert.acknowledged_by || "–", alert.note ? el("span", { class: "small quiet alert-what" }, `“${alert.note}”`) : null));
  }));
});

const WHAT = { raised: "raised", again: "came again", escalated: "went up", returned: "over", acknowledged: "acknowledged", shelved: "shelved", unshelved: "taken off the shelf", shelf_ended: "time on the shelf up", closed: "done with" };

function steps({ steps: taken, raised_at_s }) {
  const lines = taken.map(({ at_s, what, who, detail }) => el("li", {}, `after ${span(at_s - raised_at_s)}: ${WHAT[what]}${who ? ` by ${who}` : ""}${detail ? ` (${detail})` : ""}`));
  return el("details", { class: "small" }, el("summary", {}, "What happened"), el("ol", { class: "alert-steps" }, ...lines));
}

// --------------------------------------------------------------------------------------------------------- incidents
const STATES = { keeping: ["info", "…", "being kept"], complete: ["good", "✓", "complete"], cut_off: ["warn", "◐", "cut off"] };

const showIncidents = onChange((incidents) => {
  $("no-incidents").hidden = incidents.length > 0;
  $("incidents-wrap").hidden = incidents.length === 0;
  $("incidents").replaceChildren(...incidents.map(incidentRow));
});

function incidentRow(incident) {
  const { incident_id: id, device_name, causes, began_at_s, ends_at_s, state, size_bytes } = incident;
  const why = causes.map(({ sentence, who }) => (who ? `${who} has asked for it.` : sentence)).join(" ");
  const size = state === "keeping" ? "" : `, ${Math.max(1, Math.round(size_bytes / 1024))} KB`;
  const about = `${device_name}, ${date(causes[0].at_s)}`;
  const remove = me.role === "admin" ? el("button", { type: "button", class: "slim plain danger", "aria-label": `Delete the incident: ${about}`, disabled: state === "keeping", onclick: () => forget(id, about) }, "Delete") : null;
  return el("tr", { ...ROW, id: `incident-${id}` }, el("td", { ...CELL, class: "when" }, date(causes[0].at_s)), el("th", HEAD, device_name), el("td", CELL, why),
    el("td", { ...CELL, class: "wide" }, badge(...STATES[state]), ` ${span(ends_at_s - began_at_s)}${size}`),
    el("td", { ...CELL, class: "actions" }, el("a", { class: "button slim", href: `/walks?incident=${id}`, "aria-label": `Look at it: the incident of ${about}` }, "Look at it"), el("a", { class: "button slim", href: `/api/incidents/${id}/bundle.zip`, download: "", "aria-label": `Download the incident: ${about}` }, "Download"), remove));
}

async function forget(id, about) {
  const wanted = await sure({ title: "Delete this incident?", text: `${about}. It cannot be had back.`, yes: "Delete it" });
  if (wanted) await attempt(async () => { await ask("DELETE", `/api/incidents/${id}`); await refresh(); });
}

$("keep").addEventListener("click", () => openForm({
  title: "Keep the last 30 s", lead: "What a device sent in the last half minute is kept as an incident, and the next half minute with it.", submitText: "Keep it",
  fields: [{ name: "device", label: "Device", type: "select", options: devices.filter(({ connected }) => connected).map(({ id, name }) => [id, name]), value: chosen() ?? undefined, required: true }],
  submit: async ({ device }) => { await post(`/api/devices/${encodeURIComponent(device)}/keep`); await refresh(); },
}));

// ------------------------------------------------------------------------------------------------------------- sound
const SOUND = {
  off: "Sound is off. Alerts are seen here and in the header of every page; with sound they are heard as well, while a page of the console is open.",
  on: "Sound is on: five quick tones for high, three for medium, one for low. High is heard again every 10 s and medium every 30 s until somebody acknowledges it.",
  waiting: "Sound is wanted, but this browser lets a page sound only after something has been pressed on it: press the button.",
};
const drawSound = onChange((state) => {
  setText($("sound-words"), SOUND[state]);
  setText($("sound-switch"), state === "on" ? "Switch the sound off" : "Switch the sound on");
  for (const button of document.querySelectorAll("[data-test]")) button.disabled = state !== "on";
});
$("sound-switch").addEventListener("click", () => sound.set(sound.state !== "on"));
for (const button of document.querySelectorAll("[data-test]")) button.addEventListener("click", () => sound.play(button.dataset.test));

// -------------------------------------------------------------------------------------------------------------- live
await refresh();
const onNews = onChange(() => refresh().catch(() => {}));
onAlerts((alerts, elapsed_s, known) => {
  drawSound(sound.state);
  if (known) onNews(alerts.map(({ id, phase, times, priority, active, incident_id }) => [id, phase, times, priority, active, incident_id]));
});
setInterval(() => refresh().catch(() => {}), REFRESH_EVERY_MS);

ready();
