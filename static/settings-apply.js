/* Asking before settings are changed: what changes, why, and for how long what safety hangs on is tried out. */

import { el } from "./dom.js";
import { openForm } from "./form.js";
import { differenceTable } from "./setting-words.js";

/**
 * Ask whether these differences shall run on a device; `send(consent)` asks the device, and throws a sentence that keeps the
 * question open. `walking`: somebody is being led. Resolves with whether it was sent.
 */
export function askToApply({ title, found, device, walking, trial_s, send }) {
  const safety = found.some(({ spec }) => spec.safety);
  const locked = safety && walking;
  const notes = el("div", { class: "stack" }, differenceTable(found, "Runs now", "Then"));
  if (safety) {
    notes.append(el("p", { class: "note warn" }, el("strong", {}, "People’s safety hangs on this. "),
      "It is tried out: the device goes back by itself unless somebody presses “Keep it” in time, also when this page or the console is gone."));
  }
  if (locked) {
    notes.append(el("p", { class: "note bad" }, el("strong", {}, "Somebody is being led. "),
      "Better wait until they stand at their destination. They will hear: “Settings are being changed.”"));
  }
  const fields = [{ name: "why", label: "Why? (kept in the log)", type: "text", maxlength: 300 }];
  if (safety) fields.push({ name: "trial_s", label: "Try it out for so many seconds", type: "number", value: trial_s, min: 10, max: 600, required: true });
  if (locked) fields.unshift({ name: "override_reason", label: "Why must it be changed now? (kept in the log)", type: "text", maxlength: 300, required: true });
  return openForm({
    title, fields, before: notes, wide: true, submitText: safety ? "Try it out" : `Apply to ${device}`,
    submit: (values) => send({ ...values, confirmed: safety }),
  });
}
