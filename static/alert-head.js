/* Alerts in the header of every page: how many there are, their sound, the title of the tab, and what a screen reader hears of new ones. */

import { onAlerts } from "./alert-feed.js";
import { AlertSound, SoundSchedule, worstOf } from "./alert-sound.js";
import { el, onChange, setText } from "./dom.js";

export const MARKS = { high: ["bad", "▲"], medium: ["warn", "■"], low: ["info", "●"] };
const WAITING = ["unacknowledged", "returned"];
const SOUND_WORDS = { off: "Sound off", on: "Sound on", waiting: "No sound yet" };
const SOUND_LABELS = {
  off: "Sound of alerts is off: switch it on", on: "Sound of alerts is on: switch it off",
  waiting: "Sound of alerts waits until something is pressed on this page: press here",
};
const STARTING_S = 6;
const title = document.title;
const count = el("a", { id: "alert-count", href: "/alerts", class: "badge" });
const toggle = el("button", { type: "button", class: "plain slim", id: "alert-sound", onclick: () => sound.set(sound.state !== "on") });
const soundLine = el("div", { class: "people sound-line", id: "sound-line", role: "status", hidden: true },
  el("span", {}, "The sound of alerts is switched on, but this browser keeps a page silent until something is pressed on it."),
  el("button", { type: "button", class: "slim", onclick: () => sound.set(true) }, "Let alerts sound"));
const said = el("p", { class: "visually-hidden", id: "alert-said", role: "alert" });
const schedule = new SoundSchedule();
let told = null;

export const sound = new AlertSound(showSound);

/** What stands in the header; it says nothing until the console has told. */
export function alertHead() {
  return el("div", { class: "alert-head" }, count, toggle, said);
}

/** A line below the header, where the sound of alerts is wanted and the browser does not let it sound yet. */
export function alertSoundLine() {
  return soundLine;
}

/** Follow the alerts from now on. */
export function watchAlerts() {
  onAlerts((alerts, elapsed_s, known) => {
    const waiting = (alerts ?? []).filter(({ phase }) => WAITING.includes(phase));
    drawCount({ known, starting: alerts === null && elapsed_s < STARTING_S, waiting: waiting.length, total: alerts?.length ?? 0, worst: worstOf(waiting) });
    if (!known) return;
    say(alerts);
    const priority = schedule.next(alerts, performance.now() / 1000);
    if (priority !== null) sound.play(priority);
    for (const place of document.querySelectorAll(".walker-alerts[data-device]")) drawFor(place, alerts);
  });
}

const drawCount = onChange(({ known, starting, waiting, total, worst }) => {
  let [kind, mark] = worst ? MARKS[worst] : ["", "○"];
  if (!known && !starting) [kind, mark] = ["warn", "✕"];
  count.className = `badge ${kind}`;
  count.dataset.mark = mark;
  setText(count, starting ? "Alerts" : countWords(known, waiting, total));
  document.title = waiting && known ? `(${waiting}) ${title}` : title;
});

function countWords(known, waiting, total) {
  if (!known) return "Alerts not known";
  if (waiting) return waiting === 1 ? "1 alert" : `${waiting} alerts`;
  return total ? `No new alerts, ${total} seen` : "No alerts";
}

/** Say new alerts of high priority, each once; what stood there before the page was opened is counted in the header. */
function say(alerts) {
  const high = alerts.filter(({ priority, phase }) => priority === "high" && phase === "unacknowledged");
  const fresh = high.filter(({ id, times }) => told && !told.has(`${id} ${times}`));
  told = new Set(high.map(({ id, times }) => `${id} ${times}`));
  if (fresh.length) setText(said, `Alert: ${fresh.map(({ sentence }) => sentence).join(" ")}`);
}

function showSound({ state, isDecided, heard, last }) {
  toggle.dataset.state = state;
  soundLine.hidden = state !== "waiting" || !isDecided;
  toggle.setAttribute("aria-label", SOUND_LABELS[state]);
  toggle.title = SOUND_LABELS[state];
  setText(toggle, SOUND_WORDS[state]);
  if (last) Object.assign(toggle.dataset, { heard, last });
}

/** Show the worst alert of one device where a list of devices has a place for it. */
function drawFor(place, alerts) {
  const mine = alerts.filter(({ device_id, phase }) => device_id === place.dataset.device && phase !== "shelved");
  const key = JSON.stringify(mine.map(({ id, priority, phase }) => [id, priority, phase]));
  if (place.dataset.shown === key) return;
  place.dataset.shown = key;
  place.replaceChildren(...mine.slice(0, 1).map(({ priority, title: what }) => {
    const more = mine.length > 1 ? ` and ${mine.length - 1} more` : "";
    return el("span", { class: `badge ${MARKS[priority][0]}`, "data-mark": MARKS[priority][1] }, `${what}${more}`);
  }));
}
