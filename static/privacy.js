import { get, post } from "./api.js";
import { $, el, setText } from "./dom.js";
import { sure } from "./form.js";
import { ready, start } from "./shell.js";
import { attempt, toast } from "./toast.js";

const REFRESH_MS = 10_000;
const WHAT = {
  watch: "Watched", past_walk: "Looked at a past walk", incident: "Looked at an incident", colour: "Asked for pictures in colour",
  export: "Downloaded an incident",
};
const me = await start();
const isAdmin = me.role === "admin";
$("days-form").hidden = !isAdmin;
let shownDays = null;
show(await get("/api/privacy"));
setInterval(() => { if (!document.hidden) attempt(async () => show(await get("/api/privacy"))); }, REFRESH_MS);

function show(privacy) {
  const days = `${privacy.days} ${privacy.days === 1 ? "day" : "days"}`;
  $("kept").replaceChildren(...keptRows(days));
  $("days").min = privacy.min_days;
  $("days").max = privacy.max_days;
  if (shownDays !== privacy.days) $("days").value = shownDays = privacy.days;
  showRun(privacy.last_run);
  $("no-log").hidden = privacy.accesses.length > 0;
  $("log-wrap").hidden = privacy.accesses.length === 0;
  $("log").replaceChildren(...privacy.accesses.map((entry) => el("tr", {}, el("td", { class: "when" }, span(entry)), el("th", { scope: "row" }, entry.who),
    el("td", {}, WHAT[entry.what], entry.detail && el("span", { class: "quiet small" }, ` ${entry.detail}`), about(entry)), el("td", {}, entry.device || "every one"))));
}

function keptRows(days) {
  return [
    ["Walks that a device has recorded", days, "Console's machine; everybody who is signed in. Only where the walker shares them."],
    ["Incidents", days, "Console's machine; everybody who is signed in. Without colour pictures."],
    ["Events of the devices: what was said, pressed and found", days, "Database; everybody who is signed in."],
    ["Who has watched and looked", days, "Database, this page, and the walker's device."],
    ["The audit log: who gave which order to which device", "stays", `Database; admins. After ${days} without destination; sentences said to a walker are never in it.`],
    ["Settings that devices were asked to run", "stays", "Database; everybody who is signed in. Nothing of where anybody was."],
    ["Recordings of map walks", "stays", "Console's machine; who maps. They are the map's own data, made by a sighted person to map the building."],
    ["Pictures in colour", "never kept", "Only who asked sees them, while the walker allows it."],
  ].map(([what, kept, where]) => el("tr", {}, el("th", { scope: "row" }, what), el("td", {}, kept), el("td", { class: "quiet small wide" }, where)));
}

function showRun(run) {
  const problems = run?.problems ?? [];
  $("problems").hidden = problems.length === 0;
  $("problems").replaceChildren(el("p", {}, "Something that is too old could not be deleted. It is tried again every hour."),
    el("ul", {}, ...problems.map((problem) => el("li", {}, problem))));
  if (run === null) return setText($("last-run"), "Nothing has been looked through yet since the console started.");
  const counts = Object.entries(run.deleted).filter(([, count]) => count > 0).map(([kind, count]) => `${kind}: ${count}`);
  setText($("last-run"), `Last looked through ${new Date(run.at_s * 1000).toLocaleString()}: ${counts.length ? `deleted ${counts.join(", ")}` : "nothing was too old"}.`);
}

function span({ what, began_at_s, ended_at_s }) {
  const began = new Date(began_at_s * 1000);
  const ended = new Date(ended_at_s * 1000);
  if (what !== "watch") return began.toLocaleString();
  return `${began.toLocaleString()} – ${began.toDateString() === ended.toDateString() ? ended.toLocaleTimeString() : ended.toLocaleString()}`;
}

function about({ about_s }) {
  return about_s === null ? null : el("span", { class: "quiet small" }, ` of ${new Date(about_s * 1000).toLocaleString()}`);
}

$("days-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  setText($("days-problem"), "");
  const days = Number($("days").value);
  const fewer = days < shownDays;
  if (fewer && !(await sure({ title: `Keep only ${days} days?`, text: "What is older is deleted at once, and cannot be brought back.", yes: "Delete it" }))) return;
  try {
    show(await post("/api/privacy/days", { days }));
    toast("Kept.");
  } catch (error) {
    setText($("days-problem"), error.message);
  }
});

$("delete").addEventListener("click", async () => {
  const text = "What is deleted cannot be brought back.";
  if (await sure({ title: `Delete what is older than ${shownDays} days?`, text, yes: "Delete it" })) {
    await attempt(async () => show(await post("/api/privacy/delete")));
  }
});

ready();
