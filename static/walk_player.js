/* Plays a past walk, or an incident: which instant is shown, how fast it goes on, and the instants themselves, fetched a few seconds ahead. */

import { get } from "./api.js";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10];
const BLOCK = 50;
const BLOCKS_KEPT = 16;
/** From this speed on only every fifth cycle is shown: no eye sees more. */
const COARSE_FROM = 4;
const COARSE = 5;

export class WalkPlayer {
  /** `url` is what is asked for instants. `moved(at_s)` is called at each change of the instant, `show(instant)` with what it looked like, `changed()` when it plays or pauses. */
  constructor({ url, length_s, cycle_s }, { moved, show, changed, failed }) {
    Object.assign(this, { url, length_s, cycle_s, moved, show, changed, failed });
    this.at_s = 0;
    this.speed = 1;
    this.playing = false;
    this.blocks = new Map();
    this.shown = null;
  }

  // ------------------------------------------------------------------------------------------------------- time
  toggle() { return this.playing ? this.pause() : this.play(); }

  play() {
    if (this.at_s >= this.length_s) this.at_s = 0;
    this.playing = true;
    this.last = performance.now();
    this.changed();
    requestAnimationFrame(() => this.tick());
  }

  pause() {
    this.playing = false;
    this.changed();
    this.seek(this.at_s);
  }

  tick() {
    if (!this.playing) return;
    const now = performance.now();
    const next_s = this.at_s + (this.speed * (now - this.last)) / 1000;
    this.last = now;
    // What has not come yet is waited for: nothing is skipped because of a slow line.
    if (this.instant(next_s) || next_s >= this.length_s) this.go(next_s);
    if (this.at_s >= this.length_s) return this.pause();
    requestAnimationFrame(() => this.tick());
  }

  seek(at_s) { this.go(at_s); }

  step(cycles) {
    if (this.playing) this.pause();
    this.go((Math.round(this.at_s / this.cycle_s) + cycles) * this.cycle_s);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.draw();
  }

  go(at_s) {
    this.at_s = Math.min(Math.max(at_s, 0), this.length_s);
    this.moved(this.at_s);
    this.draw();
  }

  draw() {
    const instant = this.instant(this.at_s);
    if (!instant || instant === this.shown) return;
    this.shown = instant;
    this.show(instant);
  }

  // --------------------------------------------------------------------------------------------------- instants
  get step_s() { return this.playing && this.speed >= COARSE_FROM ? COARSE * this.cycle_s : this.cycle_s; }

  /** The instant at a time, where it is here; else it is fetched, and shown when it has come. */
  instant(at_s) {
    const step_s = this.step_s;
    const steps = Math.min(Math.max(at_s, 0), this.length_s) / step_s;
    // Who goes to a mark sees what it is about: what held from then on, not what had held until then.
    const number = this.playing ? Math.floor(steps + 1e-6) : Math.ceil(steps - 1e-6);
    const block = this.block(step_s, Math.floor(number / BLOCK));
    if (this.playing) this.block(step_s, Math.floor(number / BLOCK) + 1);
    return Array.isArray(block) ? block[number % BLOCK] ?? null : null;
  }

  block(step_s, index) {
    const begin_s = index * BLOCK * step_s;
    if (begin_s > this.length_s) return null;
    const key = `${step_s} ${index}`;
    const known = this.blocks.get(key);
    this.blocks.delete(key);
    this.blocks.set(key, known ?? this.fetch(key, begin_s, begin_s + (BLOCK - 1) * step_s, step_s));
    while (this.blocks.size > BLOCKS_KEPT) this.blocks.delete(this.blocks.keys().next().value);
    return this.blocks.get(key);
  }

  async fetch(key, from, to, step) {
    try {
      const query = new URLSearchParams({ from, to: Math.min(to, this.length_s + step), step });
      const { instants } = await get(`${this.url}/instants?${query}`);
      if (this.blocks.has(key)) this.blocks.set(key, instants);
      this.draw();
    } catch (error) {
      this.blocks.delete(key);
      if (this.playing) this.pause();
      this.failed(error);
    }
  }
}
