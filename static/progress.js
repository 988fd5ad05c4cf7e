/* Progress of whatever takes longer than half a second, in one place of the page, said once to a screen reader. */

import { el, setText } from "./dom.js";

const SHOWN_AFTER_MS = 500;
const running = new Map();
let node = null;
let questions = 0;

/** Run something, and show that it runs where it takes long. Returns what it returns. */
export async function during(text, work) {
  const key = Symbol(text);
  const before = questions;
  const timer = setTimeout(() => { running.set(key, { text, before }); draw(); }, SHOWN_AFTER_MS);
  try {
    return await work();
  } finally {
    clearTimeout(timer);
    running.delete(key);
    draw();
  }
}

/** Somebody is asked something: what waits for the answer does not look busy. Returns what ends it. */
export function asked() {
  questions += 1;
  draw();
  return () => { questions -= 1; draw(); };
}

function draw() {
  const busy = [...running.values()].filter(({ before }) => before >= questions);
  if (node === null) {
    if (busy.length === 0) return;
    node = el("div", { class: "busy", role: "status" }, el("div", { class: "progress endless" }, el("div")), el("p"));
    document.body.append(node);
  }
  node.hidden = busy.length === 0;
  if (busy.length) setText(node.querySelector("p"), busy.at(-1).text);
}

/** A bar from 0 to 1 with a sentence; `bar.show(null)` is a bar that says only that something runs. */
export function progressBar(label) {
  const inner = el("div");
  const bar = el("div", { class: "progress", role: "progressbar", "aria-label": label, "aria-valuemin": "0", "aria-valuemax": "100" }, inner);
  const text = el("p", { class: "small quiet" });
  const whole = el("div", { class: "stack tight", hidden: true }, bar, text);
  return {
    node: whole,
    show(share, sentence) {
      whole.hidden = false;
      bar.classList.toggle("endless", share === null);
      if (share === null) bar.removeAttribute("aria-valuenow");
      else bar.setAttribute("aria-valuenow", String(Math.round(100 * share)));
      inner.style.width = share === null ? "" : `${100 * share}%`;
      setText(text, sentence);
    },
    hide() { whole.hidden = true; },
  };
}
