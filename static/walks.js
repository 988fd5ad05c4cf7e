/* The page Walks: the list of past walks and where on the map things happened in them; or one walk, or an incident, played. */

import { get, inTurn } from "./api.js";
import { $, el, onChange, setText } from "./dom.js";
import { Graph } from "./graph.js";
import { follow } from "./live.js";
import { ready, start } from "./shell.js";
import { Table } from "./table.js";
import { toast } from "./toast.js";
import { showCompared, showFigures, showLegs } from "./walk_figures.js";
import { openWalk } from "./walk_page.js";
import { WalkPlan } from "./walk_plan.js";
import { clock, date, figure } from "./walk_words.js";

const ASK_AGAIN_MS = 1500;
await start();
const graph = new Graph(() => {});
await graph.fetch();
const query = new URLSearchParams(location.search);
const [walkId, incidentId] = [query.get("walk"), query.get("incident")];

if (walkId) await showOne(walkId);
else if (incidentId) await showIncident(incidentId);
else await showList();
follow((data) => graph.heard(data), () => "devices=none");
ready();

// ------------------------------------------------------------------------------------------------------------ list
async function showList() {
  const chosen = new Set();
  const of = (row, key) => row.figures?.[key];
  const number = (value) => (value === null || value === undefined ? -1 : value);
  const deviation = (row, key) => row.figures?.deviation[key];
  const table = new Table({
    place: $("walks-section"), name: "walks", label: "Walks", searchHint: "Place, device, date…",
    empty: [el("p", {}, "No walk has come yet."), el("p", { class: "quiet" }, "A device sends the walks that the walker shares (vbr device --record DIR --share-walks), by itself, once they are over.")],
    key: (row) => row.walk_id,
    mark: (row) => chosen.has(row.walk_id),
    columns: [
      { key: "date", title: "Walked", head: true, text: (row) => String(row.began_at_s).padStart(16), cell: (row) => el("a", { href: `/walks?walk=${encodeURIComponent(row.walk_id)}`, "data-key": row.walk_id }, date(row.began_at_s)) },
      { key: "way", title: "From → to", text: (row) => (row.figures ? `${row.figures.from_place || "?"} → ${row.figures.to_place || "?"}` : row.reading ? "Being read…" : "") , cell: wayCell },
      { key: "device", title: "Device", class: "wide", text: (row) => row.device },
      { key: "length", title: "Length", class: "number", text: (row) => Math.round(row.length_s), cell: (row) => clock(row.length_s) },
      { key: "end", title: "End", text: (row) => of(row, "outcome") ?? "", cell: (row) => (of(row, "arrived") ? "✓ Arrived" : of(row, "outcome") ?? "") },
      { key: "mean", title: "Deviation, mean", class: "number", text: (row) => number(deviation(row, "mean_m")), cell: (row) => figure(deviation(row, "mean_m"), "m") },
      { key: "max", title: "Maximum", class: "number", text: (row) => number(deviation(row, "max_m")), cell: (row) => figure(deviation(row, "max_m"), "m") },
      { key: "stops", title: "Stops", class: "number", text: (row) => number(of(row, "stop_count")), cell: (row) => String(of(row, "stop_count") ?? "–") },
      { key: "on-map", title: "On the map", plain: true, text: () => "", cell: (row) => el("label", { class: "check" }, el("input", { type: "checkbox", checked: chosen.has(row.walk_id), "data-key": `${row.walk_id} chosen`, "aria-label": `Draw the walk of ${date(row.began_at_s)} on the map`, onchange: (event) => choose(row, event.target.checked) })) },
    ],
  });
  table.sortBy("date"); // the newest first
  const plan = new WalkPlan($("overlay-plan"), $("overlay-layers"), graph, "Floor plan with what happened in the chosen walks; pointing at a mark tells its figures.", "overlay");
  let rows = [];

  function choose(row, yes) {
    if (yes) chosen.add(row.walk_id);
    else chosen.delete(row.walk_id);
    drawOverlays();
  }

  const queryOf = (ids) => new URLSearchParams(ids.map((id) => ["walk", id]));

  const fetchOverlays = inTurn(async () => {
    plan.showLayers(chosen.size ? (await get(`/api/walk-overlays?${queryOf([...chosen].sort())}`)).layers : null);
  });

  const drawOverlays = onChangeOf(() => [...chosen].sort(), (ids) => {
    $("walks-csv").href = `/api/walk-figures.csv?${queryOf(ids)}`;
    setText($("overlays-words"), ids.length === 1 ? "One walk is drawn: choose others in the table." : `${ids.length} walks are drawn: choose them in the table.`);
    fetchOverlays().catch((error) => toast(error.message));
  });

  const draw = onChange(() => {
    table.show(rows);
    for (const { walk_id, figures } of rows.filter(({ walk_id: id }) => !seen.has(id)).slice(0, MOST_CHOSEN)) if (figures) { seen.add(walk_id); chosen.add(walk_id); }
    $("overlays").hidden = $("walks-csv").hidden = !rows.some(({ figures }) => figures);
    table.show(rows);
    drawOverlays();
  });

  const seen = new Set();
  const MOST_CHOSEN = 50;
  const ask = async () => {
    try {
      ({ walks: rows } = await get("/api/walks"));
      draw(rows);
    } finally {
      // What is being read is there in a moment; what a device sends, when it has come. A console that is silent now is asked again, too.
      setTimeout(() => ask().catch(() => {}), rows.some(({ reading }) => reading) ? ASK_AGAIN_MS : 10 * ASK_AGAIN_MS);
    }
  };
  await ask();
  plan.fetch();
}

function wayCell(row) {
  const words = row.figures ? `${row.figures.from_place || "?"} → ${row.figures.to_place || "?"}` : row.reading ? "Being read…" : "Cannot be read";
  return row.troubles.length ? [words, el("span", { class: "small trouble" }, `⚠ ${row.troubles.join(" ")}`)] : [words];
}

/** Call `draw` with what `data()` is now, where it differs from the last time. */
function onChangeOf(data, draw) {
  const drawIfChanged = onChange(draw);
  return () => drawIfChanged(data());
}

// -------------------------------------------------------------------------------------------------------- one walk
async function showOne(id) {
  const url = `/api/walks/${encodeURIComponent(id)}`;
  const found = await opened(url, "walk", (walk) => ({ ...walkWords(walk), names: { walk: id } }));
  if (found) await showFiguresOf(id, found.walk, found.plan);
}

function walkWords({ summary }) {
  const { figures } = summary;
  const way = figures?.from_place && figures?.to_place ? `${figures.from_place} → ${figures.to_place}` : "Walk";
  return {
    title: `${way}, ${date(summary.began_at_s)}`, mark: "Past walk",
    facts: `${summary.device}, ${clock(summary.length_s)}${figures ? `. ${figures.outcome}` : ""}`,
    banner: `Past walk, recorded ${date(summary.began_at_s)}. Nothing on this page is happening now.`,
    none: "This walk was recorded without pictures: there is no depth silhouette.",
  };
}

async function showIncident(id) {
  $("back").textContent = "All alerts";
  $("back").href = "/alerts";
  $("walk-figures-section").hidden = true;
  await opened(`/api/incidents/${encodeURIComponent(id)}`, "incident", (walk) => ({ ...incidentWords(walk), names: { incident: id } }));
}

function incidentWords({ incident, summary }) {
  const { causes } = incident;
  const [first_s, last_s] = [causes[0].at_s, causes[causes.length - 1].at_s];
  const before_s = Math.round(first_s - summary.began_at_s);
  const after_s = Math.round(summary.began_at_s + summary.length_s - last_s);
  const round = before_s === after_s ? `${before_s} s before and after` : `${before_s} s before and ${after_s} s after`;
  return {
    title: `Incident of ${date(first_s)}, ${round}`, mark: "Incident",
    facts: `${summary.device}, ${clock(summary.length_s)}. ${causes.map(({ sentence, who }) => (who ? `${who} has asked for it.` : sentence)).join(" ")}`,
    banner: `Incident of ${date(first_s)}, as the console heard it. Nothing on this page is happening now.`,
    none: "No depth silhouette came in this time.",
  };
}

/** Open the player on what `url` tells; null where that cannot be shown, which is said. */
async function opened(url, what, wordsOf) {
  $("list-view").hidden = true;
  setText($("walk-title"), `Reading the ${what}…`);
  $("walk-view").hidden = false;
  let walk;
  try {
    walk = await get(url);
  } catch (error) {
    setText($("walk-title"), `This ${what} cannot be shown`);
    $("walk-troubles").replaceChildren(el("p", { class: "note bad" }, error.message));
    for (const node of document.querySelectorAll("#walk-view > section, #walk-view > .walk-columns, #past-banner")) node.hidden = true;
    return null;
  }
  return { walk, plan: openWalk(url, walk, wordsOf(walk), graph) };
}

async function showFiguresOf(id, walk, plan) {
  const { summary, compared } = walk;
  $("walk-csv").href = `/api/walk-figures.csv?${new URLSearchParams({ walk: id })}`;
  if (summary.figures === null) {
    // It is still being read for the list.
    setTimeout(async () => showFiguresOf(id, await get(`/api/walks/${encodeURIComponent(id)}`), plan).catch((error) => toast(error.message)), ASK_AGAIN_MS);
    return;
  }
  showFigures($("walk-figures"), summary.figures);
  showLegs($("legs"), summary.figures.legs);
  showCompared($("compared"), $("compared-words"), $("compared-wrap"), compared, id);
  plan.showLayers((await get(`/api/walk-overlays?${new URLSearchParams({ walk: id })}`)).layers);
}
