/* The page Rehearse: what would be heard on a way of the draft, when and where, and how it sounds. */

import { post } from "./api.js";
import { $, badge, el, metres, onChange, setText } from "./dom.js";
import { editorPage } from "./draft.js";
import { inListOrder } from "./graph.js";
import { Plan, whereWords } from "./plan.js";
import { during } from "./progress.js";
import { Player } from "./player.js";

let result = null;
const fillers = ["start", "destination"].map(filler);
const player = new Player(showPlaying);

const { graph, begin } = await editorPage({ show: (data) => { fillPlaces(data.pois); markStale(data); } });
const plan = new Plan($("plan"), graph, (count) => `Floor plan with ${count === 1 ? "one sentence" : `${count} sentences`}, where they begin: the numbers are those of the list, which says the same in words.`);

function fillPlaces(pois) {
  const options = inListOrder(pois.filter(({ on_road }) => on_road)).map(({ id, name }) => [id, name]);
  for (const fill of fillers) fill(options);
  const few = options.length < 2;
  $("run").disabled = few;
  if (few) setText($("no-rehearsal"), "A rehearsal needs two places on the road that are connected: tag them on the page Places first.");
}

function filler(id) {
  return onChange((options) => {
    const before = $(id).value;
    $(id).replaceChildren(el("option", { value: "" }, "Choose…"), ...options.map(([value, text]) => el("option", { value }, text)));
    if (options.some(([value]) => value === before)) $(id).value = before;
  });
}

$("swap").addEventListener("click", () => {
  [$("start").value, $("destination").value] = [$("destination").value, $("start").value];
});

$("route-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  setText($("route-problem"), "");
  const [start, destination] = [$("start").value, $("destination").value];
  const missing = !start ? $("start") : !destination ? $("destination") : null;
  for (const select of [$("start"), $("destination")]) select.setAttribute("aria-invalid", String(select === missing));
  if (missing) {
    setText($("route-problem"), "Choose both places.");
    return missing.focus();
  }
  player.stop();
  try {
    result = await during("Walking through it…", () => post("/api/rehearsals", { start, destination, language: $("language").value }));
    showResult();
  } catch (error) {
    setText($("route-problem"), error.status === 404 && !graph.poi(start) ? error.message : error.status === 404 ? "This console cannot rehearse yet." : error.message);
  }
  return undefined;
});

function showResult() {
  const { utterances } = result;
  $("no-rehearsal").hidden = true;
  $("result").hidden = $("plan-section").hidden = false;
  setText($("result-title"), `${graph.nameOf(result.start)} to ${graph.nameOf(result.destination)}`);
  markStale(graph.data);
  showList();
  $("play-all").disabled = !utterances.some(({ text, sound }) => text || sound);
  setText($("voice"), result.voice === "browser" ? "Spoken by this browser: the console has no voice. Tones are left out." : "");
  plan.fetch();
  $("result-title").focus();
}

/** Show what is said, or, where it is asked for, the tones in between as well; they are played in either case. */
function showList() {
  const shown = [...result.utterances.entries()].filter(([, { text }]) => text || $("tones").checked);
  $("utterances").replaceChildren(...shown.map(([index, utterance], at) => row(utterance, index, at + 1)));
  const kind = result.refusal ? "warn" : "info";
  plan.show(shown.map(([, { x_m, y_m, text, kind: tone }], at) => ({ number: at + 1, x_m, y_m, label: text || tone, kind })));
}

$("tones").addEventListener("change", () => result && showList());

function markStale({ version }) {
  if (!result) return;
  const { refusal, length_m, total_s, utterances, graph_version } = result;
  const words = refusal ? `Nobody is led there: ${refusal}` : `${metres(length_m)}, ${clock(total_s)}, ${count(utterances.filter(({ text }) => text).length, "sentence")}, ${count(utterances.filter(({ text }) => !text).length, "tone")}.`;
  const old = graph_version !== version ? [badge("warn", "▲", `of version ${graph_version}; the draft is ${version}: rehearse it again`)] : [];
  $("summary").replaceChildren(badge(refusal ? "bad" : "good", refusal ? "✕" : "✓", refusal ? "refused" : "arrives"), ` ${words} `, ...old);
}

function row(utterance, index, number) {
  const { stamp_s, along_m, text, kind, x_m, y_m, sound } = utterance;
  const where = whereWords(graph, x_m, y_m);
  const node = el("tr", { "data-utterance": index, "data-number": number }, el("td", { class: "number" }, clock(stamp_s)), el("td", { class: "number wide" }, metres(along_m)),
    el("td", {}, el("span", { class: "numbered" }, String(number)), text ? el("b", {}, text) : el("span", { class: "quiet" }, `a tone (${kind.replaceAll("_", " ")})`)),
    el("td", { class: "wide" }, where),
    el("td", { class: "actions" }, el("button", { type: "button", class: "plain slim", disabled: !text && !sound, "aria-label": `Play ${number}: ${text || "tone"}`, onclick: () => player.play([[index, utterance]], result.language) }, "Play")));
  for (const event of ["mouseenter", "focusin"]) node.addEventListener(event, () => plan.point(number));
  return node;
}

const count = (number, word) => `${number} ${word}${number === 1 ? "" : "s"}`;

/** "1:05": minutes and seconds. */
function clock(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

$("play-all").addEventListener("click", () => player.play(result.utterances.map((utterance, index) => [index, utterance]), result.language));
$("stop").addEventListener("click", () => player.stop());

function showPlaying(index) {
  $("stop").disabled = index === null;
  for (const node of $("utterances").children) node.classList.toggle("playing", node.dataset.utterance === String(index));
  const number = $("utterances").querySelector(".playing")?.dataset.number;
  if (!number) return;
  plan.point(Number(number));
  setText($("now-playing"), `Playing ${number}`);
}

await graph.fetch();
begin();
