/* Dialogs with a form: labels, errors beside their fields and in a live region, the focus kept and given back. */

import { showDialog } from "./dialog.js";
import { el, setText } from "./dom.js";
import { during } from "./progress.js";

let count = 0;

/**
 * Open a form; resolves with whether it was sent. `fields` is a list of
 * {name, label, type: text|number|select|check|textarea, value, options: [[value, text]], hint, placeholder, required, min, max,
 * maxlength, span: columns of six in a wide form, shown: (values) => bool}. `submit(values)` throws a sentence to keep the form open, with all that was typed.
 * The browser asks before a page is left on which something was typed and not sent. `before` is a node above the fields, `extra` one under them; `onInput(values)` hears each change.
 */
export function openForm({ title, lead, fields, submitText = "Save", submit, before, extra, onInput, wide = false }) {
  const id = `form-${++count}`;
  const made = fields.map((field) => makeField(field, `${id}-${field.name}`));
  const problem = el("p", { class: "problem", role: "alert" });
  const send = el("button", { type: "submit", class: "primary" }, submitText);
  const form = el("form", { class: "stack", novalidate: true },
    el("h2", { id: `${id}-title` }, title), lead ? el("p", { class: "quiet" }, lead) : null,
    before ?? null, ...made.map(({ node }) => node), extra ?? null, problem,
    el("div", { class: "row end" }, el("button", { type: "button", onclick: () => dialog.close() }, "Cancel"), send));
  const dialog = el("dialog", { "aria-labelledby": `${id}-title`, class: wide ? "wide-dialog" : "" }, form);
  const values = () => Object.fromEntries(made.map((field) => [field.name, field.value()]));
  const arrange = () => {
    const now = values();
    for (const field of made) field.node.hidden = field.shown ? !field.shown(now) : false;
    onInput?.(now);
  };
  form.addEventListener("input", arrange);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    setText(problem, "");
    const wrong = made.filter((field) => !field.node.hidden && !field.check());
    if (wrong.length) return wrong[0].focus();
    send.disabled = true;
    try {
      await during("Saving…", () => submit(values()));
      dialog.close("sent");
    } catch (error) {
      setText(problem, error.message);
    } finally {
      send.disabled = false;
    }
  });
  arrange();
  const untouched = JSON.stringify(values());
  const askFirst = (event) => { if (JSON.stringify(values()) !== untouched) event.preventDefault(); };
  addEventListener("beforeunload", askFirst);
  return showDialog(dialog, () => (made[0] ?? send).focus()).then((answer) => {
    removeEventListener("beforeunload", askFirst);
    return answer === "sent";
  });
}

/** Ask before something is lost; resolves with whether it is wanted. */
export function sure({ title, text, extra, yes, no = "Leave it as it is" }) {
  const id = `sure-${++count}`;
  const dialog = el("dialog", { "aria-labelledby": `${id}-title`, "aria-describedby": `${id}-text` });
  const leave = el("button", { type: "button", onclick: () => dialog.close() }, no);
  dialog.append(el("div", { class: "stack" }, el("h2", { id: `${id}-title` }, title), el("p", { id: `${id}-text` }, text), extra ?? null,
    el("div", { class: "row end" }, leave, el("button", { type: "button", class: "primary", onclick: () => dialog.close("yes") }, yes))));
  return showDialog(dialog, () => leave.focus()).then((answer) => answer === "yes");
}

function makeField(spec, id) {
  const error = el("p", { class: "problem small", id: `${id}-problem` });
  const hint = spec.hint ? el("p", { class: "hint", id: `${id}-hint` }, spec.hint) : null;
  const described = [spec.hint && `${id}-hint`, `${id}-problem`].filter(Boolean).join(" ");
  const input = makeInput(spec, id, described);
  const kind = spec.span ? `field span-${spec.span}` : "field";
  const node = spec.type === "check" ? el("div", { class: kind }, el("label", { class: "check" }, input, spec.label), hint, error)
    : el("div", { class: kind }, el("label", { for: id }, spec.label), input, hint, error);
  const say = (sentence) => {
    setText(error, sentence);
    if (sentence) input.setAttribute("aria-invalid", "true");
    else input.removeAttribute("aria-invalid");
  };
  input.addEventListener("input", () => say(""));
  return {
    name: spec.name, node, shown: spec.shown,
    value: () => valueOf(spec, input),
    check: () => { const sentence = faultOf(spec, input); say(sentence); return !sentence; },
    focus: () => { input.focus(); input.select?.(); },
  };
}

function makeInput(spec, id, described) {
  const about = { id, name: spec.name, "aria-describedby": described, required: spec.required, autocomplete: "off", maxlength: spec.maxlength };
  if (spec.type === "select") {
    const select = el("select", about, ...spec.options.map(([value, text]) => el("option", { value }, text)));
    if (spec.value !== undefined) select.value = spec.value;
    return select;
  }
  if (spec.type === "check") return el("input", { ...about, type: "checkbox", checked: spec.value });
  if (spec.type === "textarea") return el("textarea", { ...about, value: spec.value ?? "", placeholder: spec.placeholder });
  const number = spec.type === "number" ? { type: "number", step: "any", min: spec.min, max: spec.max, inputmode: "decimal" } : {};
  return el("input", { ...about, ...number, value: spec.value ?? "", placeholder: spec.placeholder });
}

function valueOf(spec, input) {
  if (spec.type === "check") return input.checked;
  if (spec.type === "number") return input.value === "" ? null : Number(input.value);
  return spec.type === "textarea" ? input.value : input.value.trim();
}

function faultOf(spec, input) {
  const { validity } = input;
  if (validity.badInput) return "Write a number, as 3.5.";
  if (spec.required && (validity.valueMissing || (spec.type !== "check" && !input.value.trim()))) {
    return spec.type === "select" ? "Choose one." : "Fill this in.";
  }
  if (validity.rangeUnderflow || validity.rangeOverflow) {
    return spec.max === undefined ? `Give at least ${spec.min}.` : `Give a number from ${spec.min} to ${spec.max}.`;
  }
  return validity.valid ? "" : input.validationMessage;
}
