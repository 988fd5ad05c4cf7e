/* Alerts as sound, after IEC 60601-1-8: the more urgent, the more pulses, the faster and the higher. A browser lets a page sound only after
 * somebody has pressed something on it, so whether it may is shown, and asked for again after each loading. */

const WANTED = "alert-sound";
/** Hz of each pulse, seconds from one to the next, seconds until it is heard again (null: once). */
const PATTERNS = {
  high: { tones_hz: [523, 659, 784, 659, 784], step_s: 0.16, again_s: 10 },
  medium: { tones_hz: [523, 659, 523], step_s: 0.28, again_s: 30 },
  low: { tones_hz: [523], step_s: 0.5, again_s: null },
};
const LEVEL = 0.25;
/** A browser may let a page sound because something was pressed on the one before in this tab; that is so only a moment after its loading. */
const DECIDES_MS = 1000;

export class AlertSound {
  /** `show(sound)` is called at each change of `state`: off, on, or waiting (wanted, but nobody has pressed anything on this page yet). */
  constructor(show) {
    this.show = show;
    this.context = null;
    this.isDecided = false; // whether it is known by now that this page may not sound
    this.wanted = localStorage.getItem(WANTED) === "on";
    this.heard = 0;
    this.last = "";
    for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, () => { if (this.wanted) this.open(); }, { capture: true, passive: true });
    if (this.wanted) this.open();
    this.tell();
    setTimeout(() => { this.isDecided = true; this.tell(); }, DECIDES_MS);
  }

  get state() {
    if (!this.wanted) return "off";
    return this.context?.state === "running" ? "on" : "waiting";
  }

  /** Switch it on or off; to be called by what somebody presses. */
  async set(on) {
    this.wanted = on;
    localStorage.setItem(WANTED, on ? "on" : "off");
    if (on) await this.open();
    else await this.context?.suspend();
    this.tell();
  }

  async open() {
    this.context ??= this.made();
    if (this.context.state !== "running") await this.context.resume().catch(() => {});
    this.tell();
  }

  made() {
    const context = new AudioContext();
    context.addEventListener("statechange", () => this.tell());
    return context;
  }

  tell() {
    this.show(this);
  }

  /** Sound a priority, where sound is on; returns whether it was heard. */
  play(priority) {
    if (this.state !== "on") return false;
    const { tones_hz, step_s } = PATTERNS[priority];
    tones_hz.forEach((tone_hz, index) => this.pulse(tone_hz, this.context.currentTime + 0.03 + index * step_s, step_s * 0.7));
    this.heard += 1;
    this.last = priority;
    this.tell();
    return true;
  }

  pulse(tone_hz, at_s, length_s) {
    const level = new GainNode(this.context, { gain: 0 });
    const tone = new OscillatorNode(this.context, { type: "triangle", frequency: tone_hz });
    level.gain.setValueAtTime(0, at_s);
    level.gain.linearRampToValueAtTime(LEVEL, at_s + 0.015);
    level.gain.setValueAtTime(LEVEL, at_s + length_s - 0.03);
    level.gain.linearRampToValueAtTime(0, at_s + length_s);
    tone.connect(level).connect(this.context.destination);
    tone.start(at_s);
    tone.stop(at_s + length_s);
  }
}

const RANKS = ["high", "medium", "low"];
/** The longest pattern is over by then: what is no more urgent waits for so long. */
const REST_S = 1.5;

/** When what is to be heard: each alert once as soon as nothing more urgent sounds, and again while it waits for somebody. */
export class SoundSchedule {
  constructor() {
    this.heard = new Set();
    this.heardAt_s = { high: -Infinity, medium: -Infinity, low: -Infinity };
  }

  /** Return the priority to sound now, or null. `alerts` are sorted as they come; `now_s` is any steady clock. */
  next(alerts, now_s) {
    const waiting = alerts.filter(({ phase }) => phase === "unacknowledged").map((alert) => ({ ...alert, key: `${alert.id} ${alert.times} ${alert.priority}` }));
    this.heard = new Set(waiting.map(({ key }) => key).filter((key) => this.heard.has(key)));
    const priority = worstOf(waiting.filter((alert) => !this.heard.has(alert.key) || this.isDue(alert.priority, now_s)));
    if (priority === null || this.isSounding(priority, now_s)) return null;
    for (const alert of waiting) if (alert.priority === priority) this.heard.add(alert.key);
    this.heardAt_s[priority] = now_s;
    return priority;
  }

  isDue(priority, now_s) {
    const { again_s } = PATTERNS[priority];
    return again_s !== null && now_s - this.heardAt_s[priority] >= again_s;
  }

  /** Whether something sounds that is as urgent, or more. */
  isSounding(priority, now_s) {
    return RANKS.slice(0, RANKS.indexOf(priority) + 1).some((rank) => now_s - this.heardAt_s[rank] < REST_S);
  }
}

/** The most urgent priority among alerts; null for none. */
export function worstOf(alerts) {
  return RANKS.find((rank) => alerts.some(({ priority }) => priority === rank)) ?? null;
}
