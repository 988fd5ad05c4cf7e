/* Progress of whatever takes longer than half a second, in one place of the page, said once to a screen reader. */

import { el, setText } from "./dom.js";

const SHOWN_AFTER_MS = 500;
const running = new Map();
let node = null;

/** Run something, and show that it runs where it takes long. Returns what it returns. */
export async function during(text, work) {
  const key = Symbol(text);
  const timer = setTimeout(() => { running.set(key, text); draw(); }, SHOWN_AFTER_MS);
  try {
    return await work();
  } finally {
    clearTimeout(timer);
    running.delete(key);
    draw();
  }
}

function draw() {
  if (node === null) {
    if (running.size === 0) return;
    node = el("div", { class: "busy", role: "status" }, el("div", { class: "progress endless" }, el("div")), el("p"));
    document.body.append(node);
  }
  node.hidden = running.size === 0;
  if (running.size) setText(node.querySelector("p"), [...running.values()].at(-1));
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
