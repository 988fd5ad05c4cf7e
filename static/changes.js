/* A difference between two versions in words: what is added, removed, and changed from what to what. */

import { decimals, el } from "./dom.js";
import { fieldName, thingName, valueWords } from "./words.js";

const GROUPS = [["added", "+", "Added"], ["removed", "−", "Removed"], ["changed", "≠", "Changed"]];
const SHOWN = 200;
const SAME_M = 0.01;
const MEASURED = ["x_m", "y_m", "length_m"];

export function changesList(changes, nameOf, nothing = "Nothing differs.") {
  if (changes.length === 0) return el("p", { class: "empty" }, nothing);
  const told = changes.filter((one) => one.change !== "changed" || fieldsOf(one, nameOf).length);
  const moved = changes.length - told.length;
  const slight = moved ? el("p", { class: "quiet" }, `${moved === 1 ? "One thing lies" : `${moved} things lie`} elsewhere by less than a centimetre.`) : null;
  const groups = GROUPS.map(([change, mark, title]) => [mark, title, told.filter((one) => one.change === change)]).filter(([, , some]) => some.length);
  return el("div", { class: "stack" }, ...groups.map(([mark, title, some]) => el("section", {},
    el("h3", {}, el("span", { class: "mark", "aria-hidden": "true" }, mark), `${title}: ${some.length}`),
    el("ul", { class: "changes" }, ...some.slice(0, SHOWN).map((one) => el("li", {}, el("b", {}, thingName(one.kind, one.name)), ...whereOf(one), ...fieldsOf(one, nameOf))),
      some.length > SHOWN ? el("li", { class: "quiet" }, `and ${some.length - SHOWN} more`) : null))), slight);
}

const whereOf = ({ at_m }) => (at_m ? [el("span", { class: "change" }, `at ${at_m.map((value) => decimals(value)).join(", ")}`)] : []);

function fieldsOf({ fields }, nameOf) {
  const away_m = Math.hypot(by_m(fields.x_m), by_m(fields.y_m));
  const moved = away_m >= SAME_M ? [el("span", { class: "change" }, `moved by ${away_m.toFixed(2)} m`)] : [];
  const told = Object.entries(fields).filter(([field, values]) => !MEASURED.includes(field) || (field === "length_m" && Math.abs(by_m(values)) >= SAME_M));
  return [...moved, ...told.map(([field, [before, after]]) => {
    const from = valueWords(field, before, nameOf);
    const to = valueWords(field, after, nameOf);
    return el("span", { class: "change" }, from === to ? `${fieldName(field)}: ${to}` : `${fieldName(field)}: ${from} → ${to}`);
  })];
}

const by_m = ([before, after] = [0, 0]) => after - before;
