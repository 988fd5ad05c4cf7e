/* Help: the keys, and the tour. The same keys work in the scene and in the tables. */

import { showDialog } from "./dialog.js";
import { el } from "./dom.js";
import { isTyping } from "./keys.js";
import { openTour } from "./tour.js";

export const SHORTCUTS = [
  { where: "Everywhere", keys: "?", does: "Show this help" },
  { where: "Everywhere", keys: "Ctrl+Z", does: "Take back your last edit" },
  { where: "Everywhere", keys: "Ctrl+Shift+Z", does: "Make it again" },
  { where: "Everywhere", keys: "Esc", does: "Close a dialog, or drop what was begun; nothing is changed" },
  { where: "Tables", keys: "/", does: "Go to the search field of the table" },
  { where: "Tables", keys: "Alt+N", does: "Add a place" },
  // As console/viewer/shortcuts.py has them.
  { where: "Scene", keys: "1", does: "Select and move" },
  { where: "Scene", keys: "2", does: "Tag a place: click on the road" },
  { where: "Scene", keys: "3", does: "Connect two places" },
  { where: "Scene", keys: "4", does: "Draw a road" },
  { where: "Scene", keys: "J", does: "Propose connections between neighbours" },
  { where: "Scene", keys: "Enter", does: "Accept what is shown" },
  { where: "Scene", keys: "Backspace", does: "Take the last point back" },
  { where: "Scene", keys: "Delete", does: "Delete what is selected" },
  { where: "Scene", keys: "Arrows", does: "Move the selected place by 0.1 m; with Shift by 1 m" },
  { where: "Scene", keys: "N, C, R", does: "Next place, connection or road; with Shift the one before" },
  { where: "Scene", keys: "Space", does: "Click where the cross is" },
  { where: "Scene", keys: "O, P, F", does: "Overview, from above, follow the walker" },
];

export function openHelp() {
  const dialog = el("dialog", { class: "wide-dialog", "aria-labelledby": "help-title" });
  const tour = el("button", { type: "button", onclick: () => { dialog.close(); openTour(); } }, "Show the tour");
  dialog.append(el("div", { class: "stack" }, el("h2", { id: "help-title" }, "Help"),
    el("p", {}, "Everything that the scene does by dragging is done by the tables and forms of these pages as well. Nothing reaches a walker before it is published."),
    el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Keys" }, el("table", {}, el("caption", { class: "visually-hidden" }, "Keys"),
      el("thead", {}, el("tr", {}, ...["Where", "Key", "What it does"].map((title) => el("th", { scope: "col" }, title)))),
      el("tbody", {}, ...SHORTCUTS.map(({ where, keys, does }) => el("tr", {}, el("td", {}, where), el("th", { scope: "row" }, el("kbd", {}, keys)), el("td", {}, does)))))),
    el("div", { class: "row end" }, tour, el("button", { type: "button", class: "primary", onclick: () => dialog.close() }, "Close"))));
  showDialog(dialog);
}

document.addEventListener("keydown", (event) => {
  if (event.key !== "?" || isTyping(event.target) || document.querySelector("dialog[open]")) return;
  event.preventDefault();
  openHelp();
});
