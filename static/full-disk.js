/* A line on every page for as long as the disk of the console's machine is full: what is not kept meanwhile, and what to do. */

import { onAlerts } from "./alert-feed.js";
import { el, onChange } from "./dom.js";

const line = el("div", { class: "banner", id: "disk-line", role: "status", hidden: true });

/** The line, to be put below the header. */
export function fullDiskLine() {
  return line;
}

/** Follow the disk from now on. */
export function watchDisk() {
  onAlerts((alerts, elapsed_s, known, fullDisk) => draw(fullDisk));
}

const draw = onChange((fullDisk) => {
  // Shown before anything is in it: a screen reader hears what is put into what is there.
  line.hidden = fullDisk === null;
  line.replaceChildren(...(fullDisk === null ? [] : [
    "The disk of the console's machine is full, or nearly: new walks, incidents and what people change may not be kept until there is room. ",
    ...whatToDo(fullDisk),
  ]));
});

/** Only who may free room is told where. */
function whatToDo({ folder }) {
  if (!folder) return ["Tell whoever looks after the console."];
  return [`Free room on the disk of ${folder}, or let old walks be deleted: `, el("a", { href: "/privacy" }, "Privacy"), "."];
}
