/* The page Checks: what the checker has found in the draft, and where. */

import { Checker, SEVERITIES, severityCount } from "./checker.js";
import { $, badge, el, onChange, setText } from "./dom.js";
import { editorPage } from "./draft.js";
import { Plan, whereWords } from "./plan.js";
import { progressBar } from "./progress.js";
import { showInScene } from "./scene.js";
import { attempt } from "./toast.js";

const bar = progressBar("How far the check is");
const checker = new Checker(showAll);
$("progress").append(bar.node);

const { graph, begin } = await editorPage({ show: () => { showAll(); plan.fetch(); } });
const plan = new Plan($("plan"), graph, (count) => (count ? `Floor plan with ${count === 1 ? "one mark" : `${count} marks`}: the numbers are those of the list, which says the same in words.` : "Floor plan; nothing is marked on it."));

$("run").addEventListener("click", () => attempt(() => checker.begin(), "Beginning the check…"));
for (const id of ["filter-text", "filter-severity"]) $(id).addEventListener("input", showAll);

function showAll() {
  const { state } = checker;
  $("run").disabled = !checker.isThere || checker.isRunning;
  const [kind, words] = stateWords(state, graph.data.version);
  $("state").className = `note ${kind}`;
  setText($("state"), words);
  if (checker.isRunning) bar.show(state.percent / 100, `Looking at the draft: ${state.percent} %`);
  else bar.hide();
  const found = state.findings;
  $("findings-section").hidden = found.length === 0;
  showFindings({ found: found.map((finding, index) => ({ ...finding, number: index + 1 })), text: $("filter-text").value, severity: $("filter-severity").value });
}

function stateWords(state, version) {
  if (!checker.isThere) return ["warn", "This console has no checker yet: nothing here has been looked at."];
  if (checker.isRunning) return ["", "The draft is being looked at."];
  if (state.stage === "failed") return ["bad", state.sentence];
  if (state.version === null) return ["", "Nobody has checked this draft yet. “Check the draft” looks at all of it; it takes a few seconds."];
  const counts = Object.keys(SEVERITIES).map((severity) => severityCount(state.findings, severity)).filter(Boolean).join(", ");
  const result = counts ? `Version ${state.version} has ${counts}.` : `Nothing was found in version ${state.version}.`;
  return state.version === version ? [counts ? "" : "good", result] : ["warn", `${result} The draft is version ${version} by now: check it again.`];
}

const showFindings = onChange(({ found, text, severity }) => {
  const words = text.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const chosen = found.filter((finding) => (!severity || finding.severity === severity) && words.every((word) => `${finding.text} ${finding.action}`.toLowerCase().includes(word)));
  setText($("found-count"), chosen.length === found.length ? `${found.length} in all` : `${chosen.length} of ${found.length}`);
  $("findings").replaceChildren(...Object.keys(SEVERITIES).map((one) => group(one, chosen.filter((finding) => finding.severity === one))).filter(Boolean));
  plan.show(chosen.map(({ number, x_m, y_m, text: label, severity: kind }) => ({ number, x_m, y_m, label, kind: SEVERITIES[kind].kind })));
});

function group(severity, findings) {
  if (findings.length === 0) return null;
  return el("section", { class: "stack tight" }, el("h3", {}, SEVERITIES[severity].title), el("ol", { class: "findings" }, ...findings.map(item)));
}

function item(finding) {
  const { kind, mark, one } = SEVERITIES[finding.severity];
  const node = el("li", {}, badge(kind, mark, `${finding.number} · ${one}`),
    el("div", { class: "grow" }, el("p", {}, el("b", {}, finding.text)), el("p", { class: "quiet" }, finding.action), el("p", { class: "small quiet" }, whereWords(graph, finding.x_m, finding.y_m))),
    el("button", { type: "button", class: "slim", "aria-label": `Show in the scene: ${finding.text}`, onclick: () => showFinding(finding) }, "Show in the scene"));
  for (const event of ["mouseenter", "focusin"]) node.addEventListener(event, () => plan.point(finding.number));
  return node;
}

function showFinding({ x_m, y_m, poi_ids, edge_ids, road_ids }) {
  const [kind, id] = poi_ids.length ? ["poi", poi_ids[0]] : edge_ids.length ? ["edge", edge_ids[0]] : road_ids.length ? ["road", road_ids[0]] : [null, null];
  return showInScene({ point: [x_m, y_m], ...(kind ? { kind, id } : {}) });
}

await graph.fetch();
await checker.look();
begin();
