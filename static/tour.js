/* The tour of a first visit: five steps, once per person and browser; Help shows it again. */

import { showDialog } from "./dialog.js";
import { el, setText } from "./dom.js";

const STEPS = [
  { title: "The map is a road", text: "A sighted person walked through the building once. Where they walked is the virtual blind road: everything else lies on it. The console shows it in 3D." },
  { title: "Tag places", text: "A place has a name that the walker hears, and lies so many metres along the road. Press 2 (Tag a place) and click on the road in the scene, or use “Add a place” on the page Places." },
  { title: "Connect them", text: "A connection is the piece of road between two places. “Propose connections” shows the whole graph at once; you accept it, and correct it." },
  { title: "Check and rehearse", text: "The page Checks finds what would trouble a walker. The page Rehearse says every sentence of a route, without anyone walking." },
  { title: "Publish", text: "What you edit is a draft, and every step can be taken back. A walker’s device gets it when you publish, and takes it at the next stop." },
];

const keyOf = (name) => `tour-seen-${name}`;

/** Show the tour to somebody who has not seen it in this browser. */
export function tourOnFirstVisit(me) {
  if (localStorage.getItem(keyOf(me.name))) return;
  localStorage.setItem(keyOf(me.name), "1");
  openTour();
}

export function openTour() {
  let step = 0;
  const count = el("p", { class: "small quiet" });
  const title = el("h2", { id: "tour-title", tabindex: "-1" });
  const text = el("p", { id: "tour-text" });
  const dots = el("div", { class: "dots", "aria-hidden": "true" }, ...STEPS.map(() => el("span")));
  const back = el("button", { type: "button", onclick: () => go(step - 1) }, "Back");
  const on = el("button", { type: "button", class: "primary", onclick: () => (step + 1 < STEPS.length ? go(step + 1) : dialog.close()) });
  const skip = el("button", { type: "button", class: "plain", onclick: () => dialog.close() }, "Skip the tour");
  const dialog = el("dialog", { class: "tour", "aria-labelledby": "tour-title", "aria-describedby": "tour-text" },
    el("div", { class: "stack" }, count, title, text, dots, el("div", { class: "row" }, skip, el("span", { class: "grow" }), back, on)));
  const go = (to) => {
    step = to;
    setText(count, `Tour, step ${step + 1} of ${STEPS.length}`);
    setText(title, STEPS[step].title);
    setText(text, STEPS[step].text);
    setText(on, step + 1 < STEPS.length ? "Next" : "Done");
    back.disabled = step === 0;
    skip.hidden = step + 1 === STEPS.length;
    for (const [index, dot] of [...dots.children].entries()) dot.classList.toggle("here", index === step);
    title.focus();
  };
  dialog.addEventListener("keydown", (event) => {
    const move = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (move && STEPS[step + move]) go(step + move);
  });
  showDialog(dialog, () => go(0));
}
