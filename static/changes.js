/* A difference between two versions in words: what is added, removed, and changed from what to what. */

import { el } from "./dom.js";
import { fieldName, thingName, valueWords } from "./words.js";

const GROUPS = [["added", "+", "Added"], ["removed", "−", "Removed"], ["changed", "≠", "Changed"]];
const SHOWN = 200;

export function changesList(changes, nameOf, nothing = "Nothing differs.") {
  if (changes.length === 0) return el("p", { class: "empty" }, nothing);
  const groups = GROUPS.map(([change, mark, title]) => [mark, title, changes.filter((one) => one.change === change)]).filter(([, , some]) => some.length);
  return el("div", { class: "stack" }, ...groups.map(([mark, title, some]) => el("section", {},
    el("h3", {}, el("span", { class: "mark", "aria-hidden": "true" }, mark), `${title}: ${some.length}`),
    el("ul", { class: "changes" }, ...some.slice(0, SHOWN).map((one) => el("li", {}, el("b", {}, thingName(one.kind, one.name)), ...fieldsOf(one, nameOf))),
      some.length > SHOWN ? el("li", { class: "quiet" }, `and ${some.length - SHOWN} more`) : null))));
}

function fieldsOf({ fields }, nameOf) {
  return Object.entries(fields).map(([field, [before, after]]) => {
    const from = valueWords(field, before, nameOf);
    const to = valueWords(field, after, nameOf);
    return el("span", { class: "change" }, from === to ? `${fieldName(field)}: ${to}` : `${fieldName(field)}: ${from} → ${to}`);
  });
}
