/* The tour of a first visit: what one's role comes for, once per person and browser; Help shows it again. */

import { showDialog } from "./dialog.js";
import { el, setText } from "./dom.js";

const MAP = [
  { title: "The map is a road", text: "A sighted person walked through the building once. Where they walked is the virtual blind road: everything else lies on it. The console shows it in 3D." },
  { title: "Tag places", text: "A place has a name that the walker hears, and lies so many metres along the road. Press 2 (Tag a place) and click on the road in the scene, or use “Add a place” on the page Places." },
  { title: "Connect them", text: "A connection is the piece of road between two places. “Propose connections” shows the whole graph at once; you accept it, and correct it." },
  { title: "Check and rehearse", text: "The page Checks finds what would trouble a walker. The page Rehearse says every sentence of a route, without anyone walking." },
  { title: "Publish", text: "What you edit is a draft, and every step can be taken back. A walker’s device gets it when you publish, and takes it at the next stop." },
];
const WATCH = [
  { title: "Watch a walker", text: "The page Console shows what a walker is told now, and Overview all walkers at once. Each says how old it is: LIVE, DELAYED, STALE or LOST. What is grey is over: how it is now is not known. The walker hears who watches." },
  { title: "Alerts", text: "An alert says what is wrong and what to do. “Acknowledge” tells everybody that you see to it; “Shelve” silences it for some minutes. Switch their sound on at the top of the page." },
  { title: "Ask why", text: "The tab Decision shows why the walker is told what they are told: in a sentence, in a picture of the floor round them, and check by check." },
];
const SPEAK = { title: "Speak to the walker", text: "“Say” speaks your words to the walker, “Repeat” says the last sentence again. Below stands what the device answered: without an answer, the walker may not have heard it." };
const LEAD = { title: "Lead and pause", text: "“Guide” sets a destination, “Pause” lets the walker stand until you resume, “Stop guiding” ends it. “Say” speaks your words. Below stands what the device answered: without an answer, the walker may not have heard it." };
const TUNE = [
  { title: "Settings", text: "The page Settings says what each setting means, and what differs from the defaults. What bears on safety asks first, and goes back by itself unless you keep it." },
  { title: "Try before you change", text: "“What if” on the page Settings replays a recorded walk with other settings, and shows what would have been decided otherwise." },
];
/** What each role comes for. */
const STEPS = {
  viewer: [...WATCH, SPEAK], technician: [...WATCH, SPEAK, ...TUNE], editor: [...MAP, ...WATCH, LEAD], admin: [...MAP, ...WATCH, LEAD, ...TUNE],
};

const keyOf = (name) => `tour-seen-${name}`;

/** Show the tour to somebody who has not seen it in this browser. */
export function tourOnFirstVisit(me) {
  if (localStorage.getItem(keyOf(me.name))) return;
  localStorage.setItem(keyOf(me.name), "1");
  openTour(me.role);
}

/** Show the tour of a role. */
export function openTour(role) {
  const steps = STEPS[role] ?? STEPS.viewer;
  let step = 0;
  const count = el("p", { class: "small quiet" });
  const title = el("h2", { id: "tour-title", tabindex: "-1" });
  const text = el("p", { id: "tour-text" });
  const dots = el("div", { class: "dots", "aria-hidden": "true" }, ...steps.map(() => el("span")));
  const back = el("button", { type: "button", onclick: () => go(step - 1) }, "Back");
  const on = el("button", { type: "button", class: "primary", onclick: () => (step + 1 < steps.length ? go(step + 1) : dialog.close()) });
  const skip = el("button", { type: "button", class: "plain", onclick: () => dialog.close() }, "Skip the tour");
  const dialog = el("dialog", { class: "tour", "aria-labelledby": "tour-title", "aria-describedby": "tour-text" },
    el("div", { class: "stack" }, count, title, text, dots, el("div", { class: "row" }, skip, el("span", { class: "grow" }), back, on)));
  const go = (to) => {
    step = to;
    setText(count, `Tour, step ${step + 1} of ${steps.length}`);
    setText(title, steps[step].title);
    setText(text, steps[step].text);
    setText(on, step + 1 < steps.length ? "Next" : "Done");
    back.disabled = step === 0;
    skip.hidden = step + 1 === steps.length;
    for (const [index, dot] of [...dots.children].entries()) dot.classList.toggle("here", index === step);
    title.focus();
  };
  dialog.addEventListener("keydown", (event) => {
    const move = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (move && steps[step + move]) go(step + move);
  });
  showDialog(dialog, () => go(0));
}
