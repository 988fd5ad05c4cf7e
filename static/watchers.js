/* Who watches the walker of a device, whether the walker has heard so, and colour pictures where they allow them. */

import { ago, el, onChange, setText } from "./dom.js";

const PICTURE_EVERY_MS = 1000;
const ANSWER_WITHIN_S = 30;
const ANSWER_SHOWN_S = 120;

export class WatchersPanel {
  /** Build it in an empty element. `me` is who is signed in; `ask(why)` asks the walker, and tells whether that went. */
  constructor(root, { me, ask }) {
    this.me = me;
    this.askedAt = 0;
    const id = root.id || "watchers";
    this.words = el("p", { class: "small", role: "status" });
    this.shared = el("p", { class: "small quiet" });
    this.why = el("input", { class: "grow", id: `${id}-why`, maxlength: 100, autocomplete: "off", placeholder: "To see which door it is" });
    this.answer = el("p", { class: "small", role: "status", hidden: true });
    this.button = el("button", { type: "submit" }, "Ask");
    this.form = el("form", { class: "field", onsubmit: async (event) => {
      event.preventDefault();
      if (await ask(this.why.value.trim())) this.why.value = "";
    } }, el("label", { for: `${id}-why` }, "Ask the walker for pictures in colour"), el("div", { class: "row" }, this.why, this.button),
    el("p", { class: "hint" }, "They hear who asks and why, and allow it for one minute, or not. Nothing of it is kept."), this.answer);
    this.image = el("img", { alt: "What the walker's camera sees, in colour" });
    this.caption = el("figcaption", {});
    this.figure = el("figure", { class: "colour", hidden: true }, this.image, this.caption);
    root.append(this.words, this.shared, this.figure, this.form);
    this.drawRoot = onChange((shown) => { root.hidden = !shown; });
  }

  /** Show a device, as data of the live stream; null for none. */
  show(view, { elapsed_s, linked, fresh }) {
    const shown = Boolean(view?.connected && view.sharing);
    this.drawRoot(shown);
    if (!shown) return this.hidePicture();
    setText(this.words, watchersSentence(view.watchers, this.me, fresh));
    setText(this.shared, sharedSentence(view.sharing));
    this.showPicture(view, elapsed_s, linked);
    const answer = answerSentence(view, this.me, elapsed_s);
    this.answer.hidden = !answer;
    setText(this.answer, answer);
    this.button.disabled = !linked || Boolean(view.sharing.colour_for);
  }

  showPicture({ id, sharing }, elapsed_s, linked) {
    const left_s = sharing.colour_left_s - elapsed_s;
    const mine = sharing.colour_for === this.me && left_s > 0 && sharing.colour_stamp_s !== null && linked;
    if (!mine) return this.hidePicture();
    const until = new Date(Date.now() + left_s * 1000).toLocaleTimeString();
    setText(this.caption, `The walker has allowed this until ${until}. The picture is from ${ago(sharing.colour_age_s + elapsed_s)}.`);
    this.figure.hidden = false;
    if (sharing.colour_stamp_s === this.stamp_s || performance.now() - this.askedAt < PICTURE_EVERY_MS) return;
    this.stamp_s = sharing.colour_stamp_s;
    this.askedAt = performance.now();
    this.image.src = `/api/devices/${encodeURIComponent(id)}/colour.jpg?at=${this.stamp_s}`;
  }

  /** Nothing of a picture stays on the page that may not be seen any more. */
  hidePicture() {
    if (this.figure.hidden) return;
    this.figure.hidden = true;
    this.image.removeAttribute("src");
    this.stamp_s = undefined;
  }
}

/** "You are watching; Anna too. The walker has been told." Of a device that was not heard of late nothing is said of what the walker heard. */
function watchersSentence(watchers, me, fresh) {
  if (!watchers.length) return "Nobody is counted as watching yet.";
  const others = watchers.map(({ name }) => name).filter((name) => name !== me);
  const names = new Intl.ListFormat("en").format(others);
  const you = others.length < watchers.length;
  const who = you ? `You are watching${others.length ? `; ${names} too` : ""}.` : `${names} ${others.length > 1 ? "are" : "is"} watching.`;
  if (fresh === "stale" || fresh === "lost") return `${who} Whether the walker still knows is not known.`;
  return `${who} ${watchers.every(({ told }) => told) ? "The walker has been told." : "The walker has not heard it yet."}`;
}

/** What the walker has answered to who asked last, as far as it is known; empty where it was long ago. */
function answerSentence({ commands, sharing }, me, elapsed_s) {
  const asked = (commands ?? []).filter(({ kind, who }) => kind === "ask_colour" && who === me).at(-1);
  const age_s = asked ? asked.age_s + elapsed_s : Infinity;
  if (age_s > ANSWER_SHOWN_S) return "";
  if (asked.state === "sent") {
    const left_s = Math.ceil(ANSWER_WITHIN_S - age_s);
    return left_s > 0 ? `Asked. The walker has ${left_s} s to answer; no answer is no.` : "Asked. No answer so far.";
  }
  if (asked.state === "unanswered") return "Not answered: the link has broken, or somebody has asked anew.";
  if (asked.state === "refused") return `No pictures: ${asked.refusal}`;
  const left_s = Math.ceil(sharing.colour_left_s - elapsed_s);
  if (sharing.colour_for === me && left_s > 0) return `The walker allows it for ${left_s} s more.`;
  return `Pictures are no longer shown. ${sharing.colour_ended}`;
}

function sharedSentence({ silhouettes, colour_for: who }) {
  const depth = silhouettes ? "" : "The walker shares no depth pictures. ";
  return `${depth}${who ? `${who} may see pictures in colour just now.` : ""}`.trim();
}
