/* A list of alerts: what is wrong, what to do, and the two things that somebody can do with it: acknowledge it, or shelve it for a while. */

import { onAlerts, take } from "./alert-feed.js";
import { MARKS } from "./alert-head.js";
import { post } from "./api.js";
import { badge, el, setText } from "./dom.js";
import { openForm } from "./form.js";
import { attempt } from "./toast.js";

const PHASES = {
  unacknowledged: ["", "!", "not seen"], returned: ["info", "↩", "over, not seen"], acknowledged: ["good", "✓", "seen"], shelved: ["", "◌", "shelved"],
};
const TIMES = [[5, "5 minutes"], [10, "10 minutes"], [15, "15 minutes"]];

/** "12 s", "3 min", "2 h". */
export function span(length_s) {
  if (length_s < 90) return `${Math.round(length_s)} s`;
  return length_s < 5400 ? `${Math.round(length_s / 60)} min` : `${Math.round(length_s / 3600)} h`;
}

export class AlertList {
  /** `root` is an empty element; `device()` returns the id of the device to show, or null for all. No more than `most` are shown. */
  constructor(root, { device = () => null, most = 30, empty = "No alerts." } = {}) {
    Object.assign(this, { root, device, most, emptyWords: empty });
    this.nodes = new Map();
    this.note = el("p", { class: "small quiet alert-note" });
    this.list = el("ol", { class: "alerts", "aria-label": "Alerts, the most urgent first" });
    this.more = el("p", { class: "small quiet" });
    root.tabIndex = -1;
    root.append(this.note, this.list, this.more);
    onAlerts((alerts, elapsed_s, known) => this.show(alerts ?? [], elapsed_s, known));
  }

  show(alerts, elapsed_s, known) {
    const id = this.device();
    const mine = alerts.filter(({ device_id }) => id === null || device_id === id);
    const seen = mine.slice(0, this.most);
    this.root.classList.toggle("unknown", !known);
    this.root.classList.toggle("none", mine.length === 0 && known);
    let words = mine.length ? "" : this.emptyWords;
    if (!known) words = alerts.length ? `No word from the console for ${Math.round(elapsed_s)} s: these are the alerts of then.` : "Whether there are alerts is not known.";
    setText(this.note, words);
    this.place(seen);
    for (const alert of seen) this.nodes.get(alert.id).age(alert, elapsed_s);
    const rest = mine.length - seen.length;
    this.more.replaceChildren(...(rest ? [`and ${rest} more, none more urgent: `, el("a", { href: "/alerts" }, "see all alerts")] : []));
  }

  /** Put the alerts in their order; those that are as they were stay the same nodes, and keep the focus. */
  place(alerts) {
    const focused = this.list.contains(document.activeElement) ? document.activeElement : null;
    const wanted = new Set(alerts.map(({ id }) => id));
    for (const [id, { node }] of this.nodes) {
      if (wanted.has(id)) continue;
      node.remove();
      this.nodes.delete(id);
    }
    let next = this.list.firstElementChild;
    for (const alert of alerts) {
      const { node } = this.drawn(alert);
      if (node === next) next = next.nextElementSibling;
      else this.list.insertBefore(node, next);
    }
    if (focused && document.activeElement !== focused) this.refocus(focused);
  }

  refocus(before) {
    const again = before.isConnected ? before : before.dataset.key && this.list.querySelector(`[data-key="${CSS.escape(before.dataset.key)}"]`);
    (again || this.list.querySelector("button") || this.root).focus({ preventScroll: true });
  }

  drawn(alert) {
    const { age_s, shelf_left_s, ...facts } = alert;
    const signature = JSON.stringify(facts);
    const known = this.nodes.get(alert.id);
    if (known?.signature === signature) return known;
    const made = item(alert, known?.node ?? el("li", { class: "alert" }));
    made.signature = signature;
    this.nodes.set(alert.id, made);
    return made;
  }
}

function item(alert, node) {
  const [kind, mark] = MARKS[alert.priority];
  const when = el("span", { class: "number" });
  const [phaseKind, phaseMark, phaseWords] = PHASES[alert.phase];
  node.dataset.priority = alert.priority;
  node.dataset.phase = alert.phase;
  node.replaceChildren(
    el("div", { class: "alert-top" }, badge(kind, mark, alert.priority), el("b", {}, alert.title)),
    el("p", { class: "alert-sentence" }, alert.sentence),
    ...(alert.phase === "returned" ? [] : [el("p", { class: "small alert-advice" }, alert.advice)]), // nothing is to be done for what is over
    el("p", { class: "small quiet alert-when" }, badge(phaseKind, phaseMark, phaseWords), when, ...facts(alert)),
    el("div", { class: "row" }, ...buttons(alert)));
  return { node, age: (now, elapsed_s) => setText(when, ageWords(now, elapsed_s)) };
}

function ageWords({ age_s, shelf_left_s, phase }, elapsed_s) {
  const raised = `Raised ${span(age_s + elapsed_s)} ago`;
  return phase === "shelved" ? `${raised}, silent for ${span(Math.max(0, shelf_left_s - elapsed_s))} more` : raised;
}

function facts({ title, device, times, escalated, acknowledged_by, note, phase, shelved_by, shelf_reason, incident_id }) {
  const told = [` · ${device}`];
  if (times > 1) told.push(` · came ${times} times`);
  if (escalated) told.push(" · went up: nobody had seen it for long");
  if (acknowledged_by) told.push(` · seen by ${acknowledged_by}${note ? `: “${note}”` : ""}`);
  if (phase === "shelved") told.push(` · shelved by ${shelved_by}: “${shelf_reason}”`);
  if (incident_id) told.push(" · ", el("a", { href: `/walks?incident=${incident_id}`, "aria-label": `Look at it: the incident of ${title}, ${device}` }, "Look at it"));
  return told;
}

function buttons({ id, title, device, device_id, kind, active, phase, acknowledged_by }) {
  const about = `${title}, ${device}`;
  const button = (key, words, act, kind = "slim") => el("button", { type: "button", class: kind, "data-key": `${key}-${id}`, "aria-label": `${words}: ${about}`, onclick: act }, words);
  const made = [];
  if (!acknowledged_by) {
    made.push(button("ack", "Acknowledge", () => attempt(() => act(id, "acknowledge", {})), "slim primary"));
    made.push(button("note", "Note…", () => note(id, about), "slim plain"));
  }
  if (phase === "shelved") made.push(button("unshelve", "Take off the shelf", () => attempt(() => act(id, "unshelve"))));
  else made.push(button("shelve", "Shelve…", () => shelve(id, about), "slim plain"));
  if (kind === "link_lost" && active) made.push(button("end", "End the watch…", () => endWatch(device_id, about), "slim plain"));
  return made;
}

async function act(id, what, body) {
  const { active } = await post(`/api/alerts/${id}/${what}`, body);
  take(active);
}

function note(id, about) {
  return openForm({
    title: "Acknowledge with a note", lead: about, submitText: "Acknowledge",
    fields: [{ name: "note", label: "Note", maxlength: 300, hint: "What you have seen or done; others see it, and it is kept." }],
    submit: (values) => act(id, "acknowledge", values),
  });
}

function endWatch(deviceId, about) {
  return openForm({
    title: "Miss this device no more", lead: `${about}. Do this when the walker is known to be safe: nothing tells of them until the device connects anew.`, submitText: "End the watch",
    fields: [{ name: "why", label: "Why?", maxlength: 300, required: true, hint: "It is written down, with your name." }],
    submit: async ({ why }) => take((await post(`/api/devices/${encodeURIComponent(deviceId)}/end_watch`, { why })).active),
  });
}

function shelve(id, about) {
  return openForm({
    title: "Shelve this alert", lead: `${about}. It keeps silent, and comes back by itself if it still holds then.`, submitText: "Shelve",
    fields: [
      { name: "minutes", label: "For", type: "select", options: TIMES, value: 5 },
      { name: "reason", label: "Why?", maxlength: 300, required: true, hint: "Others see it, and it is kept." },
    ],
    submit: ({ minutes, reason }) => act(id, "shelve", { minutes: Number(minutes), reason }),
  });
}
