/* Help: the keys, and the tour. The same keys work in the scene and in the tables. */

import { get } from "./api.js";
import { showDialog } from "./dialog.js";
import { el } from "./dom.js";
import { isTyping } from "./keys.js";
import { knownSession } from "./session.js";
import { openTour } from "./tour.js";

const SHORTCUTS = [
  { where: "Everywhere", keys: "?", does: "Show this help" },
  { where: "Everywhere", keys: "Ctrl+Z", does: "Take back your last edit" },
  { where: "Everywhere", keys: "Ctrl+Shift+Z", does: "Make it again" },
  { where: "Everywhere", keys: "Esc", does: "Close a dialog, or drop what was begun; nothing is changed" },
  { where: "Console", keys: "← →", does: "Go to another of the tabs Walk, Places, Decision and Events, from one of them" },
  { where: "Console", keys: "Enter", does: "Say what was typed in “Say to the walker”" },
  { where: "Console", keys: "Tab", does: "From the walker to the alerts first, then to the scene, the tabs, and Pause, Stop guiding and Repeat" },
  { where: "Walks", keys: "Space", does: "Play, or pause" },
  { where: "Walks", keys: "← →", does: "A second back or on; ten with Shift" },
  { where: "Walks", keys: ", .", does: "A cycle back or on" },
  { where: "Walks", keys: "P N", does: "To the mark before, or the next" },
  { where: "Walks", keys: "- +", does: "Slower, or faster" },
  { where: "Tables", keys: "/", does: "Go to the search field of the table" },
  { where: "Tables", keys: "Alt+N", does: "Add a place" },
];

let sceneKeys = null;

/** The keys of the scene, which knows them; none while the console does not answer. */
async function keysOfScene() {
  sceneKeys ??= await get("/api/shortcuts").then(({ groups }) => groups.flatMap(
    ([group, rows]) => rows.map(([keys, does]) => ({ where: `Scene: ${group.toLowerCase()}`, keys, does })))).catch(() => null);
  return sceneKeys ?? [];
}

export async function openHelp() {
  const keys = [...SHORTCUTS, ...(await keysOfScene())];
  if (document.querySelector("dialog[open]")) return;
  const dialog = el("dialog", { class: "wide-dialog", "aria-labelledby": "help-title" });
  const tour = el("button", { type: "button", onclick: () => { dialog.close(); openTour(knownSession().role); } }, "Show the tour");
  dialog.append(el("div", { class: "stack" }, el("h2", { id: "help-title" }, "Help"),
    el("p", {}, "Everything that the scene does by dragging is done by the tables and forms of these pages as well. No change of the map reaches a walker before it is published."),
    el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Keys" }, el("table", {}, el("caption", { class: "visually-hidden" }, "Keys"),
      el("thead", {}, el("tr", {}, ...["Where", "Key", "What it does"].map((title) => el("th", { scope: "col" }, title)))),
      el("tbody", {}, ...keys.map(({ where, keys, does }) => el("tr", {}, el("td", {}, where), el("th", { scope: "row" }, el("kbd", {}, keys)), el("td", {}, does)))))),
    el("div", { class: "row end" }, tour, el("button", { type: "button", class: "primary", onclick: () => dialog.close() }, "Close"))));
  showDialog(dialog);
}

document.addEventListener("keydown", (event) => {
  if (event.key !== "?" || isTyping(event.target) || document.querySelector("dialog[open]")) return;
  event.preventDefault();
  openHelp();
});
