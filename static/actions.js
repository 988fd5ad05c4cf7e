/* What can be asked of a walker's device, and what became of it by the device's own acknowledgement. */

import { post } from "./api.js";
import { $, commandBadge, el, onChange, setText } from "./dom.js";
import { sure } from "./form.js";
import { inListOrder } from "./graph.js";
import { sentences } from "./sentences.js";
import { attempt } from "./toast.js";

const AGAIN_AFTER_MS = 1000;
const SHOWN = 3;
const SHOWN_S = 90;
/** What went well needs nobody's attention any more. */
const ACCEPTED_SHOWN_S = 15;
const SLOW_S = 3;

export class Actions {
  /** Works the controls of the page Console. `placeName(id)` is a place of the map in words. */
  constructor({ mayEdit, placeName }) {
    Object.assign(this, { mayEdit, placeName, device: null, asked: new Map() });
    this.enableSentences = sentences($("sentences"), (text) => this.ask("say", { text }));
    this.drawCommands = onChange((lines) => $("commands").replaceChildren(...lines.map(({ state, words }) => el("li", { "data-state": state }, commandBadge(state), el("span", { title: words }, words)))));
    this.showDestinations = onChange((destinations) => drawDestinations(destinations));
    for (const what of ["pause", "resume", "repeat"]) $(what).addEventListener("click", () => this.ask(what));
    $("guide").addEventListener("click", () => this.guideTo($("destination").value));
    $("destination").addEventListener("change", nameGuideButton);
    $("clear").addEventListener("click", () => this.stopGuiding());
    $("say-form").addEventListener("submit", async (event) => {
      event.preventDefault();
      const text = $("say").value.trim();
      if (text && (await this.ask("say", { text }))) $("say").value = "";
    });
    // "Resume" stays hidden until a device is paused: beside "Pause" it is too wide for a phone.
    if (!mayEdit) for (const node of document.querySelectorAll(".guiding")) node.hidden = true;
  }

  /** Ask the device that is shown for something; what was asked just now is not asked twice (a double click). */
  async ask(what, body) {
    const { id } = this.device;
    const key = JSON.stringify([id, what, body]);
    if (performance.now() - (this.asked.get(key) ?? -Infinity) < AGAIN_AFTER_MS) return false;
    this.asked.clear();
    this.asked.set(key, performance.now());
    const went = await attempt(() => post(`/api/devices/${encodeURIComponent(id)}/${what}`, body));
    if (!went) this.asked.delete(key);
    return went;
  }

  /** Whoever is on their way somewhere is not led elsewhere by one click: less so where they chose it themselves. */
  async guideTo(poi_id) {
    const { id, name, state, leads_somebody } = this.device;
    const from = leads_somebody ? state.destination_id : null;
    const whose = state?.destination_by ? `${state.destination_by} has chosen that.` : `${name} has chosen that themselves.`;
    const wanted = !from || from === poi_id || (await sure({
      title: `Lead ${name} elsewhere?`, yes: `Guide to ${this.placeName(poi_id)}`, no: `Keep ${this.placeName(from)}`,
      text: `${name} is on the way to ${this.placeName(from)}. ${whose} The walker hears who leads them, and can refuse.`,
    }));
    if (wanted && this.device?.id === id) await this.ask("destination", { poi_id });
  }

  async stopGuiding() {
    const { id, name, state, leads_somebody } = this.device;
    const where = state?.destination_id ? ` to ${this.placeName(state.destination_id)}` : "";
    const wanted = !leads_somebody || (await sure({
      title: "Stop guiding?", text: `${name} is on the way${where}. The walker is told that guidance has ended, and stands without it.`,
      yes: "Stop guiding", no: "Go on guiding",
    }));
    // While the question stood open another device may have been chosen.
    if (wanted && this.device?.id === id) await this.ask("clear");
  }

  /** Show what can be asked of the device, and what was. */
  show(device, { fresh, linked, elapsed_s, age_s }) {
    this.device = device;
    const able = Boolean(device?.connected && linked);
    const mode = device?.state?.mode;
    const mayLead = able && this.mayEdit;
    $("guide").disabled = !(mayLead && $("destination").value);
    $("say-send").disabled = $("repeat").disabled = !able;
    this.enableSentences(able);
    $("pause").hidden = !this.mayEdit || mode === "paused";
    $("resume").hidden = !this.mayEdit || mode !== "paused";
    $("pause").disabled = !(mayLead && (mode === "guiding" || mode === "lost"));
    $("resume").disabled = !mayLead;
    $("clear").disabled = !(mayLead && device?.state?.destination_id && mode !== "arrived");
    const note = device ? whyNot(device, fresh, linked, age_s) : "";
    $("act-note").hidden = !note;
    setText($("act-note"), note);
    this.drawCommands((device?.commands ?? []).filter((command) => isShown(command, elapsed_s)).slice(-SHOWN)
      .map((command) => ({ state: command.state, words: this.words(command, elapsed_s) })));
  }

  words(command, elapsed_s) {
    const { kind, detail, state, refusal, took_s, age_s } = command;
    const what = WORDS[kind](kind === "set_destination" ? this.placeName(detail) : detail);
    if (state === "sent") return age_s + elapsed_s > SLOW_S ? `${what}: no answer for ${Math.round(age_s + elapsed_s)} s` : what;
    const took = took_s === null ? "" : ` after ${took_s < 9.95 ? took_s.toFixed(1) : Math.round(took_s)} s`;
    return `${what}${took}${refusal ? `: ${refusal}` : ""}`;
  }
}

const WORDS = {
  begin_map_walk: () => "Begin a map walk", end_map_walk: () => "End the map walk", clear: () => "Stop guiding", pause: () => "Pause",
  resume: () => "Resume", repeat: () => "Repeat", set_destination: (place) => `Guide to ${place}`, say: (text) => `Say “${text}”`,
  apply_settings: (revision) => `Apply settings, revision ${revision}`, keep_settings: (revision) => `Keep settings, revision ${revision}`,
  give_up_settings: (revision) => `Go back from settings, revision ${revision}`,
};

function isShown({ kind, state, age_s }, elapsed_s) {
  return kind in WORDS && age_s + elapsed_s < (state === "running" ? ACCEPTED_SHOWN_S : SHOWN_S);
}

/** Why nothing can be asked, or what to know before it is. */
function whyNot(device, fresh, linked, age_s) {
  if (!linked) return "The console does not answer: nothing can be asked of the device until it is there again.";
  if (!device.connected) return "Nothing can be asked until it is back.";
  if (fresh === "stale" || fresh === "lost") {
    const seen = age_s === null ? "has sent nothing yet" : `was heard ${Math.round(age_s)} s ago`;
    return `${device.name} ${seen}: what you ask now may reach the walker late, or not at all.`;
  }
  return "";
}

function drawDestinations(destinations) {
  const before = $("destination").value;
  const options = (chosen) => inListOrder(chosen).map(({ id, name }) => el("option", { value: id }, name));
  const junctions = options(destinations.filter(({ kind }) => kind === "junction"));
  $("destination").replaceChildren(
    el("option", { value: "" }, "Choose a place…"), ...options(destinations.filter(({ kind }) => kind !== "junction")),
    ...(junctions.length ? [el("optgroup", { label: "Junctions" }, ...junctions)] : []));
  if (destinations.some(({ id }) => id === before)) $("destination").value = before;
  nameGuideButton();
}

function nameGuideButton() {
  const chosen = $("destination").selectedOptions[0];
  setText($("guide"), chosen?.value ? `Guide to ${chosen.textContent}` : "Guide");
}
