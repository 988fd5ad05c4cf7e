/* One past walk, or an incident: the player, the strip, the plan, and the same panels as live, marked so that nobody takes them for now. */

import { $, el, icon, setText } from "./dom.js";
import { toast } from "./toast.js";
import { TracePanel } from "./trace.js";
import { SPEEDS, WalkPlayer } from "./walk_player.js";
import { WalkPlan } from "./walk_plan.js";
import { marksList, sayTime, Strip } from "./walk_strip.js";
import { clock, timeOfDay } from "./walk_words.js";
import { WalkInScene } from "./walk_scene.js";
import { Walker } from "./walker.js";

const STEP_S = 1;
const LEAP_S = 10;

/** Show what `url` tells of a walk or an incident, with its `words` ({title, facts, banner, mark, none, names}); returns its plan. */
export function openWalk(url, walk, words, graph) {
  const { summary } = walk;
  setText($("walk-title"), words.title);
  setText($("walk-facts"), words.facts);
  setText($("past-banner"), words.banner);
  setText($("no-depth"), words.none);
  $("walk-troubles").replaceChildren(...walk.troubles.map((trouble) => el("p", { class: "note warn" }, trouble)));
  $("no-depth").hidden = summary.has_pictures;
  document.title = `${words.title} · Walks · Virtual blind road`;

  const clockOf = (at_s) => new Date((summary.began_at_s + at_s) * 1000).toLocaleTimeString("en-GB");
  const scene = new WalkInScene($("in-scene"), words.names, clockOf);
  const depthUrl = ({ depth_at_s }) => `${url}/depth.jpg?at=${depth_at_s}`;
  const trace = new TracePanel($("past-trace"));
  const walker = new Walker(
    { now: $("past-walker"), figures: $("past-figures"), depth: summary.has_pictures ? $("past-depth") : null, events: $("past-happened") },
    { prefix: "past-", depthUrl });
  const plan = new WalkPlan($("walk-plan"), $("walk-layers"), graph, "Floor plan with the road, the route, the walker's trail by its distance from the route, and the walker at this instant.", "walk");
  const strip = new Strip($("strip"), (at_s) => player.seek(at_s));
  const player = new WalkPlayer({ url, length_s: walk.length_s, cycle_s: walk.cycle_s }, {
    moved: (at_s) => {
      strip.move(at_s);
      sayTime($("player-time"), at_s, walk.length_s);
      setText($("player-date"), timeOfDay(summary.began_at_s + at_s));
    },
    show: (instant) => {
      scene.move(instant.at_s);
      const { view } = instant;
      setText($("past-mark"), `${words.mark}: ${clock(instant.at_s, true)}`);
      // How fresh it was then: what was old already looks old. The banner and the frame say that all of it is past.
      const fresh = view.freshness;
      $("past").dataset.freshness = fresh;
      walker.show({ ...view, depth_at_s: instant.depth_at_s }, { elapsed_s: 0, age_s: view.age_s, fresh, poi: (poi) => graph.poi(poi) });
      trace.show({ ...view, depth_url: depthUrl(instant) }, { elapsed_s: 0, fresh });
      plan.place(view.state?.pose ?? null, view.state?.quality === "localized");
    },
    changed: () => showPlaying(player),
    failed: (error) => toast(error.message),
  });

  strip.show(walk);
  plan.showWalk(walk);
  plan.fetch();
  const seek = (at_s) => player.seek(at_s);
  const stops = marksList($("marks"), walk.marks, seek).map(({ at_s }) => at_s);
  controls(player, stops);
  showPlaying(player);
  player.seek(0);
  return plan;
}

function showPlaying(player) {
  $("play").replaceChildren(icon(player.playing ? "paused" : "play"), player.playing ? "Pause" : "Play");
}

function controls(player, stops) {
  const previous = () => player.seek(stops.findLast((at_s) => at_s < player.at_s - 0.3) ?? 0);
  const next = () => player.seek(stops.find((at_s) => at_s > player.at_s + 1e-3) ?? player.length_s);
  const faster = (by) => {
    const speed = SPEEDS[Math.min(Math.max(SPEEDS.indexOf(player.speed) + by, 0), SPEEDS.length - 1)];
    $("speed").value = speed;
    player.setSpeed(speed);
  };
  $("play").addEventListener("click", () => player.toggle());
  $("previous").addEventListener("click", previous);
  $("next").addEventListener("click", next);
  $("speed").replaceChildren(...SPEEDS.map((speed) => el("option", { value: speed }, `${speed}×`)));
  $("speed").value = 1;
  $("speed").addEventListener("change", () => player.setSpeed(Number($("speed").value)));
  const keys = {
    " ": () => player.toggle(), ",": () => player.step(-1), ".": () => player.step(1), p: previous, n: next,
    "-": () => faster(-1), "+": () => faster(1), "=": () => faster(1), Home: () => player.seek(0), End: () => player.seek(player.length_s),
    ArrowLeft: (by) => player.seek(player.at_s - by), ArrowRight: (by) => player.seek(player.at_s + by),
  };
  document.addEventListener("keydown", (event) => {
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act || event.ctrlKey || event.altKey || event.metaKey || takesKey(event.target, event.key)) return;
    event.preventDefault();
    act(event.shiftKey ? LEAP_S : STEP_S);
  });
}

/** Whether something that has the focus needs the key for itself. */
function takesKey(node, key) {
  if (node.closest("dialog")) return true;
  if (node.matches("input[type=range]")) return false;
  if (key === " ") return node.matches("button, a, summary, input, select, textarea");
  return node.matches("input:not([type=checkbox]), select, textarea");
}
