/* A past walk in the 3D scene of this person: it goes with the player, and the scene ends it by itself when nothing is heard. */

import { ask, post } from "./api.js";
import { setText } from "./dom.js";
import { toast } from "./toast.js";

/** The scene gives the past up after ten seconds of silence. */
const STILL_THERE_MS = 3000;
const CLOSED = "No scene is open: open the page Console in another tab or window, and show it again.";

export class WalkInScene {
  /** `button` switches it; `names` is {walk: id} or {incident: id}; `clockOf(at_s)` is the time of day of then. */
  constructor(button, names, clockOf) {
    Object.assign(this, { button, names, clockOf, on: false, at_s: 0, asking: false, again: false });
    button.addEventListener("click", () => (this.on ? this.end() : this.begin()));
    addEventListener("pagehide", () => { if (this.on) fetch("/api/view/past", { method: "DELETE", keepalive: true }); });
    this.draw();
  }

  draw() {
    this.button.setAttribute("aria-pressed", String(this.on));
    setText(this.button, this.on ? "End it in the scene" : "Show in the scene");
  }

  begin() {
    this.on = true;
    this.draw();
    this.timer = setInterval(() => this.tell(), STILL_THERE_MS);
    return this.tell();
  }

  async end(why) {
    this.on = false;
    clearInterval(this.timer);
    this.draw();
    if (why) toast(why);
    await ask("DELETE", "/api/view/past").catch(() => {}); // the scene ends it by itself
  }

  /** The player is at another instant. */
  move(at_s) {
    if (at_s === this.at_s) return;
    this.at_s = at_s;
    this.tell();
  }

  /** One request at a time: what came in between is told in the next one. */
  async tell() {
    if (!this.on) return;
    this.again = this.asking;
    if (this.asking) return;
    this.asking = true;
    try {
      const { scenes } = await post("/api/view/past", { ...this.names, at_s: this.at_s, clock: this.clockOf(this.at_s) });
      if (this.on && !scenes) await this.end(CLOSED);
    } catch (error) {
      if (this.on) await this.end(error.message);
    }
    this.asking = false;
    if (this.again) this.tell();
  }
}
