import { get, inTurn, patch, post } from "./api.js";
import { $, badge, el, onChange, setText, tableRow } from "./dom.js";
import { follow } from "./live.js";
import { SettingRow } from "./setting-row.js";
import { differences, differenceTable, humanName, orderProblems, rangeProblem, valueWords } from "./setting-words.js";
import { askToApply } from "./settings-apply.js";
import { Presets } from "./settings-presets.js";
import { ready, start } from "./shell.js";
import { attempt } from "./toast.js";
import { WhatIf } from "./what-if.js";

const ANSWER_SHOWN_MS = 6000;
const ASK_AGAIN_MS = 1000;
const me = await start();
const { settings: specs, orders, trial_s } = await get("/api/settings");
const byKey = new Map(specs.map((spec) => [spec.key, spec]));
const defaults = Object.fromEntries(specs.map((spec) => [spec.key, spec.default]));
const rows = new Map(specs.map((spec) => [spec.key, new SettingRow(spec, change)]));
const draft = new Map();
let device = null;
let running = defaults;
let revisions = [];
let sent = null;
let able = false;
const showCompared = onChange(drawCompared);
let wantedDevice = sessionStorage.getItem("device") ?? "";

build();
const whatIf = new WhatIf($("what-if"), specs, () => Object.fromEntries(fit()));
const presets = new Presets($("presets"), specs, { use, changed: fillCompare });
if (me.mayTune) {
  for (const node of document.querySelectorAll(".tuning")) node.hidden = false;
  attempt(() => Promise.all([presets.load(), whatIf.load()]));
}
const link = follow(showLive, () => `devices=one&device=${encodeURIComponent(wantedDevice)}`);
draw();

// ----------------------------------------------------------------------------------------------------------- build
function build() {
  for (const group of [...new Set(specs.map((spec) => spec.group))]) {
    const mine = specs.filter((spec) => spec.group === group);
    $("groups-nav").append(el("a", { href: `#group-${group}` }, mine[0].group_title));
    $("groups").append(el("section", { class: "card", id: `group-${group}`, "aria-labelledby": `title-${group}` },
      el("header", {}, el("h2", { id: `title-${group}` }, mine[0].group_title)), ...mine.map(({ key }) => rows.get(key).node)));
  }
  $("groups").append(el("p", { class: "empty", id: "no-settings", hidden: true }, "No setting is like this: search for something else, or show all."));
  $("settings-search").addEventListener("input", find);
  $("settings-filter").addEventListener("change", find);
  $("draft-discard").addEventListener("click", () => { draft.clear(); draw(); });
  $("draft-what-if").addEventListener("click", () => whatIf.ask());
  $("draft-apply").addEventListener("click", () => applyDraft());
  $("trial-keep").addEventListener("click", () => endTrial(true));
  $("trial-back").addEventListener("click", () => endTrial(false));
  for (const id of ["compare-from", "compare-to"]) $(id).addEventListener("change", compare);
  addEventListener("beforeunload", (event) => { if (draft.size) event.preventDefault(); });
}

function find() {
  const words = $("settings-search").value.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const filter = $("settings-filter").value;
  const kept = { all: () => true, changed: ({ key }) => running[key] !== defaults[key], safety: ({ safety }) => safety, draft: ({ key }) => draft.has(key) }[filter];
  let count = 0;
  for (const row of rows.values()) {
    const shown = kept(row.spec) && words.every((word) => row.text.includes(word));
    row.node.hidden = !shown;
    if (shown) count += 1;
  }
  for (const link of $("groups-nav").children) {
    const section = $(link.hash.slice(1));
    section.hidden = link.hidden = !section.querySelector(".setting:not([hidden])");
  }
  $("no-settings").hidden = count > 0;
  setText($("settings-count"), count === rows.size ? `${count} in all` : `${count} of ${rows.size}`);
}

// ----------------------------------------------------------------------------------------------------------- draft
function change(spec, value) {
  if (value === running[spec.key]) draft.delete(spec.key);
  else draft.set(spec.key, value);
  draw();
}

function use(values) {
  for (const [key, value] of Object.entries(values)) if (rows.has(key)) { if (value === running[key]) draft.delete(key); else draft.set(key, value); }
  draw();
  $("draft-apply").focus();
}

/** What of the draft is in its own range. */
function fit() {
  return [...draft].filter(([key, value]) => rangeProblem(byKey.get(key), value) === "");
}

function problems() {
  const found = new Map([...draft].map(([key, value]) => [key, rangeProblem(byKey.get(key), value)]).filter(([, sentence]) => sentence));
  const after = { ...running, ...Object.fromEntries(fit()) };
  for (const { keys, sentence } of orderProblems(orders, byKey, after)) {
    for (const key of keys.filter((each) => draft.has(each) && !found.has(each))) found.set(key, sentence);
  }
  return found;
}

function draw() {
  const wrong = problems();
  for (const [key, row] of rows) {
    row.enable(able && me.mayTune && !onTrial());
    row.show(running[key], draft.get(key), wrong.get(key) ?? "");
  }
  const safety = [...draft.keys()].filter((key) => byKey.get(key).safety).length;
  $("draft-bar").hidden = draft.size === 0;
  const count = `${draft.size} change${draft.size === 1 ? "" : "s"}${safety ? `, ${safety} of them for safety` : ""}`;
  setText($("draft-count"), wrong.size ? `${count} · ${wrong.size} cannot be` : count);
  $("draft-apply").disabled = !able || wrong.size > 0 || onTrial();
  $("draft-what-if").disabled = wrong.size > 0;
  if ($("settings-filter").value !== "all") find();
  compare();
  presets.show(running, device?.id ?? null);
}

function applyDraft() {
  const values = Object.fromEntries(draft);
  return apply({ title: `Change ${draft.size} setting${draft.size === 1 ? "" : "s"}?`, values, ask: (consent) => patch(`${here()}`, { changes: values, ...consent }) });
}

async function apply({ title, values, ask }) {
  const found = differences(specs, running, values);
  const seen_revision = device.settings_revision;
  await askToApply({
    title, found, device: device.name, walking: device.leads_somebody, trial_s,
    send: async (consent) => {
      const { command } = await ask({ ...consent, seen_revision });
      const keys = found.map(({ spec }) => spec.key);
      sent = { revision: command.detail, keys };
      for (const key of keys) {
        draft.delete(key);
        rows.get(key).answer(badge("info", "…", `sent: revision ${sent.revision}`));
      }
      draw();
    },
  });
}

function endTrial(keep) {
  return attempt(() => post(`${here()}/keep`, { revision: device.settings_revision, keep }));
}

const here = () => `/api/devices/${encodeURIComponent(device.id)}/settings`;
const onTrial = () => device !== null && device.settings_trial_left_s !== null;

// ------------------------------------------------------------------------------------------------------------ live
function showLive(data, elapsed_s, linked) {
  showDevices(data.roster.map(({ id, name }) => ({ id, name })));
  const before = device;
  device = data.devices[0] ?? null;
  // It was here before the console was started anew: whoever is here now is shown.
  if (device === null && wantedDevice && data.roster.length) choose("");
  if (device && !wantedDevice) wantedDevice = device.id; // whoever comes now, this one stays
  if (before !== null && device?.id !== before.id) { draft.clear(); sent = null; }
  able = Boolean(device?.connected && linked);
  showStatus({ name: device?.name, able, told: device?.settings_revision ?? null, linked, tuning: me.mayTune, led: Boolean(device?.leads_somebody) });
  showTrial(elapsed_s);
  if (device) settle(device.commands.filter(({ kind }) => kind === "apply_settings"));
  const key = device ? `${device.id} ${device.settings_revision} ${device.connected} ${onTrial()} ${able} ${device.commands.map(({ id, state }) => `${id} ${state}`)}` : `none ${linked}`;
  if (key === showLive.key) return;
  showLive.key = key;
  if (device) fetchValues();
  else draw();
}

function showTrial(elapsed_s) {
  const tried = onTrial();
  $("trial").hidden = !tried;
  if (!tried) return;
  const left_s = Math.max(0, Math.ceil(device.settings_trial_left_s - elapsed_s));
  const changed = differences(specs, trialBefore(), running).map(({ spec, from, to }) => `${humanName(spec)} ${valueWords(spec, from)} → ${valueWords(spec, to)}`).join(", ");
  setText($("trial-text"), `Revision ${device.settings_revision}${changed ? `: ${changed}` : ""}. Unless it is kept, the device goes back by itself.`);
  setText($("trial-left"), able ? `${left_s} s left` : `${device.name} is not connected: it goes back by itself.`);
  for (const id of ["trial-keep", "trial-back"]) { $(id).hidden = !me.mayTune; $(id).disabled = !able; }
}

function trialBefore() {
  const mine = revisions.find(({ revision }) => revision === device.settings_revision);
  return mine ? Object.fromEntries(Object.entries(mine.changes).map(([key, [from]]) => [key, from])) : {};
}

/** Tell each row that was sent what became of it. */
function settle(commands) {
  const command = sent && commands.find(({ detail }) => detail === sent.revision);
  if (!command || command.state === "sent") return;
  const { keys } = sent;
  sent = null;
  const runs = command.state === "running";
  const what = runs ? [badge("good", "✓", `running: revision ${command.detail}`)] : [badge("bad", "✕", command.state === "refused" ? "refused" : "not answered"), command.refusal];
  for (const key of keys) rows.get(key).answer(...what.map((part) => part.cloneNode?.(true) ?? part));
  if (runs) setTimeout(() => { for (const key of keys) if (!sent?.keys.includes(key)) rows.get(key).answer(); }, ANSWER_SHOWN_MS);
}

const showDevices = onChange((devices) => {
  $("device-select").replaceChildren(...devices.map(({ id, name }) => el("option", { value: id }, name)));
  $("device-select").disabled = devices.length === 0;
  if (!devices.length) $("device-select").append(el("option", {}, "none"));
  if (devices.some(({ id }) => id === wantedDevice)) $("device-select").value = wantedDevice;
});

$("device-select").addEventListener("change", () => {
  choose($("device-select").value);
  sessionStorage.setItem("device", wantedDevice);
});

function choose(id) {
  wantedDevice = id;
  link.again();
}

const showStatus = onChange(({ name, able: works, told, linked, tuning, led }) => {
  let sentence = told ? `${name} runs revision ${told} of its settings.` : `${name} runs the settings that it started with.`;
  if (!linked) sentence = "No connection to the console: nothing can be changed now.";
  else if (!name) sentence = "No device has called yet: these are the defaults.";
  else if (!works) sentence = `${name} is not connected: these are the settings that it ran last, and they cannot be changed now.`;
  else if (tuning && led) sentence += " Somebody is being led: what safety hangs on is locked.";
  else if (!tuning) sentence += " Your role may look at them; a technician changes them.";
  setText($("status"), sentence);
  $("status").className = works ? "note" : "note warn";
});

const fetchValues = inTurn(async () => {
  if (device === null) return;
  const { id } = device;
  let data;
  try {
    data = await get(here());
  } catch {
    // What is shown would be old for good: the stream tells only of what changes.
    setTimeout(fetchValues, ASK_AGAIN_MS);
    return;
  }
  if (device?.id !== id) return;
  running = data.values;
  revisions = data.revisions;
  for (const [key, value] of draft) if (value === running[key]) draft.delete(key);
  draw();
  showRevisions({ revisions, running, told: device.settings_revision, may: me.mayTune && able && !onTrial() });
  fillCompare();
});

// --------------------------------------------------------------------------------------------------------- history
const KINDS = {
  running: ["good", "✓", "ran"], refused: ["bad", "✕", "refused"], sent: ["info", "…", "sent"], trying: ["warn", "◔", "tried out"],
  reverted: ["warn", "↩", "went back"], unanswered: ["warn", "○", "not answered"],
};
const showRevisions = onChange(({ revisions: all, running: now, told, may }) => {
  $("no-revisions").hidden = all.length > 0;
  $("revisions-wrap").hidden = all.length === 0;
  $("revisions").replaceChildren(...all.map((one) => revisionRow(one, now, told, may)));
});

function revisionRow(one, now, told, may) {
  const changes = Object.entries(one.changes).map(([key, [from, to]]) => `${byKey.has(key) ? humanName(byKey.get(key)) : key}: ${from} → ${to}`).join(", ");
  const why = [one.why, one.override_reason && `While somebody was led: ${one.override_reason}`].filter(Boolean).join(" ");
  const runs = one.revision === told;
  const same = differences(specs, now, one.values).length === 0;
  const state = runs && one.state === "running" ? badge("good", "✓", "runs") : badge(...KINDS[one.state]);
  const back = el("button", { type: "button", class: "plain slim", disabled: !may || same, "data-key": `back ${one.revision}`, "aria-label": `Back to revision ${one.revision}…`, onclick: () => goBack(one) }, "Back to this…");
  return tableRow(el("th", { scope: "row" }, String(one.revision)), el("td", {}, changes || "–"), el("td", { class: "wide" }, one.author),
    el("td", { class: "wide when" }, new Date(one.at_s * 1000).toLocaleString()), el("td", { class: "wide" }, why || "–"),
    el("td", {}, state, one.refusal ? el("p", { class: "small quiet" }, one.refusal) : null), el("td", { class: "actions" }, me.mayTune ? back : null));
}

function goBack(one) {
  return apply({ title: `Go back to revision ${one.revision}?`, values: one.values, ask: (consent) => post(`${here()}/back`, { revision: one.revision, ...consent }) });
}

// --------------------------------------------------------------------------------------------------------- compare
function sets() {
  return [
    ["Defaults", defaults], [device ? `What ${device.name} runs` : "", running], ["The draft", { ...running, ...Object.fromEntries(fit()) }],
    ...presets.list.filter(({ built_in, name }) => !built_in || name !== "Defaults").map(({ name, values }) => [`Preset: ${name}`, values]),
    ...revisions.map(({ revision, values }) => [`Revision ${revision}`, values]),
  ].filter(([title]) => title);
}

function fillCompare() {
  for (const [id, first] of [["compare-from", 0], ["compare-to", 1]]) {
    const select = $(id);
    const chosen = select.value;
    const titles = sets().map(([title]) => title);
    select.replaceChildren(...titles.map((title) => el("option", {}, title)));
    select.value = titles.includes(chosen) ? chosen : titles[Math.min(first, titles.length - 1)];
  }
  compare();
}

function compare() {
  const found = new Map(sets());
  const [from, to] = [$("compare-from").value, $("compare-to").value];
  const table = differences(specs, found.get(from) ?? {}, found.get(to) ?? {});
  showCompared({ table, from, to });
}

function drawCompared({ table, from, to }) {
  $("compared").replaceChildren(table.length ? differenceTable(table, from, to) : el("p", { class: "quiet" }, "Nothing differs."));
}

fillCompare();
find();
ready();
