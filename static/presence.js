/* Who else is at the map, and at what: each window says it of itself every few seconds. A courtesy, not a lock. */

import { post } from "./api.js";
import { $, el, onChange } from "./dom.js";
import { nameOfThing } from "./words.js";

const EVERY_MS = 5000;
const DOING = { looking: "looks on", editing: "edits", dragging: "moves", drawing: "draws" };
const windowId = crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`;
let mine = { doing: "looking" };

const say = (body) => post("/api/presence", { window: windowId, ...body }).catch(() => {});

/** Begin to say that this window is here, until it is closed. */
export function bePresent() {
  say(mine);
  setInterval(() => say(mine), EVERY_MS);
  addEventListener("pagehide", () => {
    const body = JSON.stringify({ window: windowId, doing: "gone" });
    fetch("/api/presence", { method: "POST", body, keepalive: true, headers: { "Content-Type": "application/json" } }).catch(() => {});
  });
  addEventListener("pageshow", (event) => { if (event.persisted) say(mine); });
}

/** Say what this window edits while `work` runs. */
export async function whileEditing(kind, id, work) {
  mine = id ? { doing: "editing", kind, id } : { doing: "editing" };
  say(mine);
  try {
    return await work();
  } finally {
    mine = { doing: "looking" };
    say(mine);
  }
}

/** Return who else is at which thing: "poi/hall" → "Bea edits". */
export function othersAt(people) {
  const at = new Map();
  for (const { user_name: name, doing, thing, you } of people) {
    if (you || !thing || doing === "looking") continue;
    const key = thing.join("/");
    at.set(key, at.has(key) ? `${at.get(key)}, ${name} ${DOING[doing]}` : `${name} ${DOING[doing]}`);
  }
  return at;
}

/** Name the others under the header. */
export function peopleLine(graph) {
  return onChange((people) => {
    const others = people.filter(({ you }) => !you);
    $("also-here").hidden = others.length === 0;
    $("also-here").replaceChildren(...(others.length ? [el("b", {}, "Also here: "), [...new Set(others.map((person) => words(person, graph)))].join("; ")] : []));
  });
}

function words({ user_name: name, where, doing, thing }, graph) {
  const place = where === "scene" ? "in the scene" : "in the tables";
  if (doing === "looking" || !thing) return `${name}, ${place}`;
  return `${name} ${DOING[doing]} ${graph ? nameOfThing(graph, thing) : "something"}`;
}
