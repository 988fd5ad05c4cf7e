/* Short messages at the edge of the page, read out by screen readers. */

import { $, el } from "./dom.js";
import { during } from "./progress.js";

const SHOWN_MS = 8000;

export function toast(sentence, { kind = "", action, onAction } = {}) {
  const close = () => node.remove();
  const node = el("div", { class: `toast ${kind}` }, el("p", {}, sentence));
  if (action) {
    node.append(el("button", { type: "button", onclick: () => { close(); onAction(); } }, action));
  }
  node.append(el("button", { type: "button", "aria-label": "Dismiss", onclick: close }, "✕"));
  const shelf = $("toasts");
  while (shelf.children.length > 2) shelf.firstElementChild.remove();
  shelf.append(node);
  let timer = setTimeout(close, SHOWN_MS);
  // Somebody who reads slowly, or has the focus inside, is not rushed.
  node.addEventListener("mouseenter", () => clearTimeout(timer));
  node.addEventListener("focusin", () => clearTimeout(timer));
  node.addEventListener("mouseleave", () => { timer = setTimeout(close, SHOWN_MS); });
}

/** Run what a button does, showing that it runs; say in a toast what was refused. Returns whether it went well. */
export async function attempt(work, words = "One moment…") {
  try {
    await during(words, work);
    return true;
  } catch (error) {
    toast(error.message, { kind: "bad" });
    return false;
  }
}
