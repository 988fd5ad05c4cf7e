/* Sentences that are said often: one press says one to the walker. They are kept in this browser. */

import { el, onChange } from "./dom.js";
import { openForm } from "./form.js";

const KEPT = "sentences";
const MOST = 12;
const LONGEST = 300;
/* None of them says anything of the way: who watches sees less of it than guidance does, and may be late. */
const FIRST = ["I can see you.", "Please wait, I am coming.", "Somebody will come to help you."];

/** Show the sentences in an empty element. `say(text)` says one. Returns a function that lets them be pressed, or not. */
export function sentences(root, say) {
  const draw = onChange((texts) => root.replaceChildren(
    ...texts.map((text) => el("button", { type: "button", class: "chip", "aria-label": `Say “${text}”`, onclick: () => say(text) }, text)),
    el("button", { type: "button", class: "plain slim", id: "edit-sentences", "data-key": "edit-sentences", "aria-haspopup": "dialog", onclick: edit }, "Edit these…")));
  const edit = async () => {
    await openForm({
      title: "Sentences that are said often", lead: `One on each line, ${MOST} at the most. They are kept in this browser.`,
      fields: [{ name: "lines", label: "Sentences", type: "textarea", value: kept().join("\n"), maxlength: MOST * (LONGEST + 1) }],
      submit: ({ lines }) => keep(lines),
    });
    draw(kept());
    enable(enabled);
  };
  let enabled = false;
  const enable = (on) => {
    enabled = on;
    for (const chip of root.querySelectorAll(".chip")) chip.disabled = !on;
  };
  draw(kept());
  enable(false);
  return enable;
}

function kept() {
  try {
    const texts = JSON.parse(localStorage.getItem(KEPT));
    if (Array.isArray(texts) && texts.every((text) => typeof text === "string" && text.length <= LONGEST)) return texts.slice(0, MOST);
  } catch { /* Something else has written there: the first ones are offered again. */ }
  return FIRST;
}

function keep(lines) {
  const texts = [...new Set(lines.split("\n").map((line) => line.trim()).filter(Boolean))];
  const long = texts.find((text) => text.length > LONGEST);
  if (long) throw new Error(`Make this one shorter, ${LONGEST} letters at the most: “${long.slice(0, 40)}…”`);
  if (texts.length > MOST) throw new Error(`Keep ${MOST} sentences at the most; these are ${texts.length}.`);
  localStorage.setItem(KEPT, JSON.stringify(texts));
}
