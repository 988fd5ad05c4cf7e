import { get, patch } from "./api.js";
import { $, badge, el, onChange, setText } from "./dom.js";
import { follow } from "./live.js";
import { ready, start } from "./shell.js";

const ANSWER_SHOWN_MS = 6000;
const me = await start();
const { settings: specs } = await get("/api/settings");
const rows = new Map();
let device = null;
let values = null;
let wantedDevice = sessionStorage.getItem("device");

build();
follow(showLive);

// ----------------------------------------------------------------------------------------------------------- build
function build() {
  for (const group of [...new Set(specs.map(({ group }) => group))]) {
    const mine = specs.filter((spec) => spec.group === group);
    const title = mine[0].group_title;
    $("groups-nav").append(el("a", { href: `#group-${group}` }, title));
    $("groups").append(el("section", { class: "card", id: `group-${group}`, "aria-labelledby": `title-${group}` },
      el("header", {}, el("h2", { id: `title-${group}` }, title)), ...mine.map(buildRow)));
  }
}

function buildRow(spec) {
  const id = spec.key.replace(".", "-");
  const title = el("div", { class: "title" }, el("label", { for: id }, humanName(spec)));
  if (spec.safety) title.append(badge("warn", "▲", "safety"));
  const state = el("p", { class: "state", "aria-live": "polite" });
  const reset = el("button", { type: "button", class: "plain slim", hidden: true, onclick: () => send(spec, spec.default) }, `Back to ${words(spec, spec.default)}`);
  const control = buildControl(spec, id);
  const node = el("div", { class: "setting" },
    el("div", {}, title, el("p", { class: "meaning", id: `${id}-meaning` }, spec.meaning),
      el("p", { class: "facts" }, `${spec.key} · default ${words(spec, spec.default)}${spec.source ? ` · ${spec.source}` : ""}`)),
    el("div", { class: "control" }, control.node, el("div", { class: "row foot" }, state, reset)));
  rows.set(spec.key, { spec, node, control, state, reset, waiting: null });
  return node;
}

/** A slider with a number, a choice or a check: `set` shows a value, `enable` lets it be touched. */
function buildControl(spec, id) {
  const about = { id, "aria-describedby": `${id}-meaning` };
  if (spec.kind === "choice") {
    const select = el("select", { ...about, onchange: () => send(spec, select.value) }, ...spec.choices.map((choice) => el("option", { value: choice }, choice)));
    return { node: select, set: (value) => { select.value = value; }, enable: (on) => { select.disabled = !on || spec.choices.length < 2; }, busy: () => document.activeElement === select };
  }
  if (spec.kind === "bool") {
    const check = el("input", { ...about, type: "checkbox", onchange: () => send(spec, check.checked) });
    return { node: check, set: (value) => { check.checked = value; }, enable: (on) => { check.disabled = !on; }, busy: () => false };
  }
  const range = { min: spec.low, max: spec.high, step: spec.step ?? "any" };
  const slider = el("input", { ...about, ...range, type: "range" });
  const number = el("input", { ...range, step: "any", type: "number", "aria-label": `${humanName(spec)}, as a number` });
  slider.addEventListener("input", () => { number.value = slider.value; });
  slider.addEventListener("change", () => send(spec, Number(slider.value)));
  number.addEventListener("change", () => send(spec, number.value === "" ? null : Number(number.value)));
  const node = el("div", {}, el("div", { class: "row" }, slider, number, el("span", { class: "unit" }, spec.unit)),
    el("div", { class: "ends", "aria-hidden": "true" }, el("span", {}, words(spec, spec.low)), el("span", {}, words(spec, spec.high)), el("span", { class: "unit" }, "")));
  return {
    node,
    set: (value) => { slider.value = value; number.value = value; },
    enable: (on) => { slider.disabled = !on; number.disabled = !on; },
    busy: () => slider.matches(":active") || document.activeElement === number,
  };
}

function humanName({ name, unit }) {
  const text = (unit ? name.replace(/_[a-z]+$/, "") : name).replaceAll("_", " ");
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function words(spec, value) {
  return `${value}${spec.unit ? ` ${spec.unit}` : ""}`;
}

// ------------------------------------------------------------------------------------------------------------ send
async function send(spec, value) {
  const row = rows.get(spec.key);
  if (value === null || values === null || value === values[spec.key]) return redraw(row);
  const question = spec.safety ? await confirm(spec, value) : { confirmed: false, why: "" };
  if (question === null) return redraw(row);
  answer(row, badge("info", "…", "sending"));
  try {
    const data = await patch(`/api/devices/${encodeURIComponent(device.id)}/settings`, { changes: { [spec.key]: value }, ...question });
    row.waiting = data.command.detail;
    row.control.set(value);
    answer(row, badge("info", "…", `sent: revision ${row.waiting}`));
  } catch (error) {
    answer(row, badge("bad", "✕", "refused"), error.message);
    redraw(row);
  }
  return null;
}

function redraw(row) {
  row.control.set(values?.[row.spec.key] ?? row.spec.default);
}

function answer(row, ...what) {
  row.state.replaceChildren(...what);
}

function confirm(spec, value) {
  const dialog = $("confirm");
  setText($("confirm-text"), `${humanName(spec)} (${spec.key}): from ${words(spec, values[spec.key])} to ${words(spec, value)}. ${spec.meaning}`);
  $("confirm-why").value = "";
  dialog.showModal();
  return new Promise((resolve) => {
    let given = null;
    $("confirm-form").onsubmit = () => { given = { confirmed: true, why: $("confirm-why").value.trim() }; };
    $("confirm-cancel").onclick = () => dialog.close();
    dialog.onclose = () => resolve(given);
  });
}

// ------------------------------------------------------------------------------------------------------------ live
function showLive(data, elapsed_s, linked) {
  showDevices(data.devices.map(({ id, name }) => ({ id, name })));
  const before = device;
  device = data.devices.find(({ id }) => id === wantedDevice) ?? data.devices[0] ?? null;
  const able = Boolean(device?.connected && linked);
  showStatus({ name: device?.name, able, told: device?.settings_revision ?? null, linked, tuning: me.mayTune });
  for (const { control } of rows.values()) control.enable(able && me.mayTune && values !== null);
  if (device) settle(device.commands.filter(({ kind }) => kind === "apply_settings"));
  const key = device ? `${device.id} ${device.settings_revision} ${device.connected} ${device.commands.map(({ state }) => state)}` : "";
  if (device && (key !== showLive.key || before === null)) {
    showLive.key = key;
    fetchValues(device.id);
  }
  if (!device && values === null) showValues(Object.fromEntries(specs.map((spec) => [spec.key, spec.default])));
}

/** Tell each row that waits what became of its change. */
function settle(commands) {
  for (const row of rows.values()) {
    const command = row.waiting && commands.find(({ detail }) => detail === row.waiting);
    if (!command || command.state === "sent") continue;
    row.waiting = null;
    if (command.state === "running") {
      answer(row, badge("good", "✓", `running: revision ${command.detail}`));
      setTimeout(() => { if (row.waiting === null) answer(row); }, ANSWER_SHOWN_MS);
    } else {
      answer(row, badge("bad", "✕", command.state === "refused" ? "refused" : "not answered"), command.refusal);
    }
  }
}

const showDevices = onChange((devices) => {
  $("device-select").replaceChildren(...devices.map(({ id, name }) => el("option", { value: id }, name)));
  $("device-select").disabled = devices.length === 0;
  if (!devices.length) $("device-select").append(el("option", {}, "none"));
  if (devices.some(({ id }) => id === wantedDevice)) $("device-select").value = wantedDevice;
});

$("device-select").addEventListener("change", () => {
  wantedDevice = $("device-select").value;
  sessionStorage.setItem("device", wantedDevice);
});

const showStatus = onChange(({ name, able, told, linked, tuning }) => {
  let sentence = told ? `${name} runs revision ${told} of its settings.` : `${name} runs the settings that it started with.`;
  if (!linked) sentence = "No connection to the console: nothing can be changed now.";
  else if (!name) sentence = "No device has called yet: these are the defaults.";
  else if (!able) sentence = `${name} is not connected: these are the settings that it ran last, and they cannot be changed now.`;
  else if (!tuning) sentence += " Your role may look at them; a technician changes them.";
  setText($("status"), sentence);
  $("status").className = able ? "note" : "note warn";
});

async function fetchValues(id) {
  const data = await get(`/api/devices/${encodeURIComponent(id)}/settings`).catch(() => null);
  if (!data || device?.id !== id) return;
  showValues(data.values);
  showRevisions(data.revisions);
}

function showValues(fresh) {
  values = fresh;
  for (const row of rows.values()) {
    const value = fresh[row.spec.key];
    const changed = value !== row.spec.default;
    if (!row.control.busy() && row.waiting === null) row.control.set(value);
    row.node.classList.toggle("changed", changed);
    row.reset.hidden = !(changed && me.mayTune);
  }
}

const KINDS = { running: ["good", "✓"], refused: ["bad", "✕"], sent: ["info", "…"] };
const showRevisions = onChange((revisions) => {
  $("no-revisions").hidden = revisions.length > 0;
  $("revisions-wrap").hidden = revisions.length === 0;
  $("revisions").replaceChildren(...revisions.map((r) => {
    const changes = Object.entries(r.changes).map(([key, [from, to]]) => `${key}: ${from} → ${to}`).join(", ");
    return el("tr", {}, el("th", { scope: "row" }, String(r.revision)), el("td", {}, new Date(r.at_s * 1000).toLocaleString()), el("td", {}, r.author),
      el("td", {}, changes), el("td", {}, r.why || "–"), el("td", {}, badge(...KINDS[r.state], r.state), r.refusal ? ` ${r.refusal}` : ""));
  }));
});

ready();
