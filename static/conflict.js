/* Two people at the same thing: both versions side by side, and a choice. Nothing that somebody typed is lost by it. */

import { showDialog } from "./dialog.js";
import { ago, el } from "./dom.js";
import { fieldName, valueWords } from "./words.js";

const HIDDEN = ["id", "edit", "poi_id", "edge_id", "road_id"];

/** Show both versions; resolves with "mine", "theirs", or "" where nobody has chosen. `edit` is what was asked for. */
export function settle(sentence, conflict, edit, graph) {
  const when = ago(Math.max(0, Date.now() / 1000 - conflict.at_s));
  const mine = conflict.yours ?? edit;
  const theirs = conflict.theirs;
  const nameOf = (id) => graph.nameOf(id);
  const fields = [...new Set([...Object.keys(mine), ...Object.keys(theirs ?? {})])].filter((field) => !HIDDEN.includes(field));
  const dialog = el("dialog", { class: "wide-dialog", "aria-labelledby": "conflict-title", "aria-describedby": "conflict-text" });
  const choose = (choice) => dialog.close(choice);
  const rows = fields.map((field) => row(field, mine[field], theirs ? theirs[field] : undefined, nameOf));
  dialog.append(el("div", { class: "stack" },
    el("h2", { id: "conflict-title" }, "Two versions"),
    el("p", { id: "conflict-text" }, sentence),
    el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Both versions" }, el("table", { class: "versions-table" },
      el("thead", {}, el("tr", {}, el("td"), el("th", { scope: "col" }, "Yours"), el("th", { scope: "col" }, `Theirs: ${conflict.by}, ${when}`), el("td"))),
      el("tbody", {}, ...(theirs ? rows : [el("tr", {}, el("th", { scope: "row" }, "Theirs"), el("td", {}, yourWords(mine, fields, nameOf)), el("td", {}, "deleted"), el("td", {}, "≠"))])))),
    conflict.yours ? null : el("p", { class: "note warn" }, "Yours can no longer be made as it is. Copy what you need of it, or go back."),
    el("div", { class: "row end" },
      el("button", { type: "button", class: "plain", onclick: () => choose("") }, "Go back, decide later"),
      el("button", { type: "button", onclick: () => choose("theirs") }, "Keep theirs"),
      el("button", { type: "button", class: "primary", disabled: !conflict.yours, onclick: () => choose("mine") }, "Use mine"))));
  return showDialog(dialog);
}

function row(field, mine, theirs, nameOf) {
  const same = mine === undefined || JSON.stringify(mine) === JSON.stringify(theirs);
  const words = (value) => valueWords(field, value, nameOf);
  return el("tr", { class: same ? "" : "differs" }, el("th", { scope: "row" }, fieldName(field)), el("td", {}, words(mine)), el("td", {}, words(theirs)),
    el("td", {}, same ? "" : el("span", {}, el("span", { "aria-hidden": "true" }, "≠ "), "differs")));
}

function yourWords(mine, fields, nameOf) {
  return fields.map((field) => `${fieldName(field)}: ${valueWords(field, mine[field], nameOf)}`).join(", ");
}
