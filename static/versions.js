/* The page Versions: check, publish, compare, go back. */

import { get, inTurn, post, postOnce } from "./api.js";
import { changesList } from "./changes.js";
import { Checker, SEVERITIES, severityCount } from "./checker.js";
import { $, badge, el, onChange, setText, tableRow } from "./dom.js";
import { editorPage } from "./draft.js";
import { openForm, sure } from "./form.js";
import { attempt, toast } from "./toast.js";

const HISTORY_AT_ONCE = 25;
const SINCE_SHOWN = 8;
let shownCount = HISTORY_AT_ONCE;
let history = [];
let versions = { versions: [] };
let compared = "";
const checker = new Checker(showSteps);

const refresh = inTurn(async () => {
  [versions, { history }] = await Promise.all([get("/api/versions"), get("/api/history")]);
  showNamed(versions);
  showHistory({ history, shownCount });
  showChoices([history, versions]);
  showSteps();
});

let shown = null;
const { me, graph, begin } = await editorPage({ show: () => { shown = refresh().catch((error) => toast(error.message, { kind: "bad" })); }, heard, asked: () => checker.look() });

const when = (at_s) => new Date(at_s * 1000).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });

// --------------------------------------------------------------------------------------------------------- publish
function showSteps() {
  const { version, published_version } = graph.data;
  const clean = version === published_version;
  $("publish").disabled = clean;
  $("check").disabled = !checker.isThere || checker.isRunning;
  drawSteps([
    clean ? ["good", "✓", "Draft", `Version ${version} is what is published.`] : ["info", "…", "Draft", `Version ${version}; devices are given version ${published_version}.`],
    checkStep(checker, version),
    clean ? ["good", "✓", "Publish", `Version ${published_version} is published.`] : ["", "○", "Publish", checker.isThere ? "Not published yet. You are asked again where the draft has not been checked, or has errors." : "Not published yet."],
  ]);
}

function checkStep({ isThere, isRunning, state }, version) {
  if (!isThere) return ["", "○", "Check", "There is no checker on this console."];
  if (isRunning) return ["info", "…", "Check", `The draft is being looked at: ${state.percent} %.`];
  if (state.stage === "failed") return ["bad", "✕", "Check", state.sentence];
  if (state.version === null) return ["", "○", "Check", "Nobody has checked this draft yet."];
  if (state.version !== version) return ["warn", "▲", "Check", `The result is of version ${state.version}; the draft is ${version}: check it again.`];
  const counts = Object.keys(SEVERITIES).map((severity) => severityCount(state.findings, severity)).filter(Boolean);
  const errors = state.findings.some(({ severity }) => severity === "error");
  const words = counts.length ? `Found: ${counts.join(", ")}.` : "Nothing was found.";
  return errors ? ["bad", "✕", "Check", words] : ["good", "✓", "Check", words];
}

const drawSteps = onChange((steps) => $("steps").replaceChildren(...steps.map(([kind, mark, title, words]) => el("li", {},
  badge(kind, mark, title), el("span", {}, words, title === "Check" && checker.isThere ? el("a", { href: "/checks", class: "after" }, "The list") : "")))));

$("check").addEventListener("click", () => attempt(() => checker.begin()));

const showDevices = onChange(({ devices, published }) => {
  $("no-devices").hidden = devices.length > 0;
  $("devices").replaceChildren(...devices.map(({ name, runs, refusal, connected }) => {
    const [kind, mark, words] = refusal ? ["bad", "✕", `refuses version ${published}: ${refusal}`]
      : runs === published ? ["good", "✓", `runs version ${runs}, which is published`] : ["info", "…", `runs version ${runs ?? "–"}, and takes ${published} at the next stop`];
    return el("li", {}, badge(kind, mark, connected ? "connected" : "not connected"), el("span", {}, el("b", {}, name), ` ${words}`));
  }));
});

function heard(data) {
  showDevices({ devices: data.roster.map(({ name, graph_version, graph_refusal, connected }) => ({ name, runs: graph_version, refusal: graph_refusal, connected })), published: data.published_version });
}

// --------------------------------------------------------------------------------------------------------- compare
const nameWords = ({ name, published }) => name ?? (published ? "published" : "");

const showChoices = onChange(() => {
  const named = new Map();
  for (const one of versions.versions) named.set(one.version, [...(named.get(one.version) ?? []), nameWords(one)]);
  const all = [...new Set([...versions.versions.map(({ version }) => version), ...history.map(({ version }) => version)])].sort((a, b) => b - a);
  const words = (version) => {
    const entry = history.find((one) => one.version === version);
    return [`Version ${version}`, named.get(version)?.join(", "), entry?.words].filter(Boolean).join(" · ").slice(0, 90);
  };
  const options = () => all.map((version) => el("option", { value: version }, words(version)));
  const [from, to] = [$("compare-from").value, $("compare-to").value];
  $("compare-from").replaceChildren(...options());
  $("compare-to").replaceChildren(el("option", { value: "" }, "the draft as it is now"), ...options());
  $("compare-from").value = all.includes(Number(from)) && from ? from : String(versions.published);
  if (all.includes(Number(to)) && to) $("compare-to").value = to;
  compare();
});

async function compare() {
  const [from, to] = [$("compare-from").value, $("compare-to").value];
  if (!from) return;
  const path = `/api/versions/${from}/difference${to ? `?to=${to}` : ""}`;
  const asked = (compared = `${path} ${graph.data.version}`);
  try {
    const { changes } = await get(path);
    if (compared === asked) $("difference").replaceChildren(changesList(changes, (id) => graph.nameOf(id), "Nothing differs between these two."));
  } catch (error) {
    $("difference").replaceChildren(el("p", { class: "problem" }, error.message));
  }
}

for (const id of ["compare-from", "compare-to"]) $(id).addEventListener("change", compare);

function compareSince(version) {
  $("compare-from").value = String(version);
  $("compare-to").value = "";
  compare();
  $("compare-from").focus();
}

// ------------------------------------------------------------------------------------------------- named, history
function actions(version, words) {
  const cell = el("td", { class: "actions" }, el("button", { type: "button", class: "plain slim", "data-key": `compare-${words}-${version}`, "aria-label": `What has changed since version ${version}`, onclick: () => compareSince(version) }, "Compare"));
  if (me.mayEdit && version !== versions.draft) {
    cell.append(el("button", { type: "button", class: "plain slim", "data-key": `back-${words}-${version}`, "aria-label": `Go back to version ${version}`, onclick: () => rollBack(version) }, "Go back"));
  }
  return cell;
}

function rollBack(version) {
  const seen = versions.draft;
  return attempt(async () => {
    if (await goneBack(version, seen)) toast(`The draft is as it was in version ${version}.`, { action: "Undo", onAction: () => graph.undo() });
  }, "Going back…");
}

/** Go back from the draft that was seen. What has been changed since is shown first, and is taken back only by whoever
 *  says so. Returns false where somebody thought better of it. */
async function goneBack(version, seen) {
  for (;;) {
    try {
      graph.take(await postOnce(`/api/versions/${version}/roll-back`, { base_version: seen }));
      return true;
    } catch (error) {
      if (error.status !== 409) throw error;
      const since = (await get("/api/history")).history.filter((one) => one.version > seen);
      if (since.length === 0) throw error;
      if (!(await isWantedBack(version, since))) return false;
      seen = since[0].version;
    }
  }
}

function isWantedBack(version, since) {
  return sure({
    title: `Go back to version ${version} all the same?`, yes: "Go back",
    text: "The draft has been changed since it was shown to you, and going back takes this away too:",
    extra: el("ul", { class: "changes" }, ...since.slice(0, SINCE_SHOWN).map(({ author, words, at_s }) => el("li", {}, el("b", {}, author), ` ${words} (${when(at_s)})`)),
      since.length > SINCE_SHOWN ? el("li", {}, `and ${since.length - SINCE_SHOWN} more`) : null),
  });
}

const showNamed = onChange(({ versions: rows }) => {
  $("no-named").hidden = rows.length > 0;
  $("named-wrap").hidden = rows.length === 0;
  $("named").replaceChildren(...rows.map((row) => tableRow(el("th", { scope: "row", class: "number" }, el("span", { class: "narrow-only" }, "Version "), String(row.version)),
    el("td", {}, row.published ? badge("good", "✓", "published") : row.name, el("span", { class: "narrow-only small quiet" }, `${row.author}, ${when(row.at_s)}`)),
    el("td", { class: "wide" }, row.author), el("td", { class: "when wide" }, when(row.at_s)), actions(row.version, "named"))));
});

const showHistory = onChange(() => {
  const rows = history.slice(0, shownCount);
  const rest = history.length - rows.length;
  $("history").replaceChildren(...rows.map((row) => tableRow(el("th", { scope: "row", class: "number" }, el("span", { class: "narrow-only" }, "Version "), String(row.version)),
    el("td", {}, row.words, el("span", { class: "narrow-only small quiet" }, `${row.author}, ${when(row.at_s)}`)),
    el("td", { class: "wide" }, row.author), el("td", { class: "when wide" }, when(row.at_s)), actions(row.version, "history"))));
  $("more-history").hidden = rest <= 0;
  setText($("more-history"), `Show ${Math.min(rest, HISTORY_AT_ONCE)} more of ${rest}`);
});

$("more-history").addEventListener("click", () => {
  shownCount += HISTORY_AT_ONCE;
  showHistory({ history, shownCount });
});

$("name-version").addEventListener("click", () => openForm({
  title: "Name the draft", lead: `Version ${graph.data.version} keeps this name, to compare with and to come back to.`, submitText: "Keep it",
  fields: [{ name: "name", label: "Name", required: true, maxlength: 80 }],
  submit: async ({ name }) => { await post("/api/versions", { name }); await refresh(); },
}));

await graph.fetch();
await Promise.all([shown, checker.look()]);
begin();
