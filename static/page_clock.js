/* What time it is: on this page, also after a sleep, and on the console, as well as that is known.
 *
 * A page shows how old things are by the console's clock: it asks the console for it, and reckons as console/clock_offset.py does: of the
 * last answers the one that was least on the way is believed, and half of its time on the way is how far it may be wrong. */

const JUMP_S = 0.5;
const WINDOW = 12;
const DRIFT_S_PER_S = 2e-4;
/** A browser rounds its clock, so as to tell no secrets. */
const RESOLUTION_S = 2e-3;

/** A clock that only goes forward, and goes on while the computer sleeps (performance.now() may stand still then). */
export class PageClock {
  constructor(steady_ms = () => performance.now(), wall_ms = () => Date.now()) {
    this.read = () => [steady_ms() / 1000, wall_ms() / 1000];
    [this.steady_s, this.wall_s] = this.read();
    this.slept_s = 0;
    this.jumps = 0;
  }

  now_s() {
    const [steady_s, wall_s] = this.read();
    const missed_s = wall_s - this.wall_s - (steady_s - this.steady_s);
    // Whether the computer slept or somebody set its clock, what is shown may be so much older than it seems.
    if (missed_s > JUMP_S) this.slept_s += missed_s;
    if (Math.abs(missed_s) > JUMP_S) this.jumps += 1;
    [this.steady_s, this.wall_s] = [steady_s, wall_s];
    return steady_s + this.slept_s;
  }
}

/** The console's clock, from answers to the question for it. */
export class ConsoleClock {
  constructor(clock = new PageClock()) {
    this.clock = clock;
    this.forget();
  }

  /** Another console may answer from now on, or this computer has slept. */
  forget() {
    this.samples = [];
    this.jumps = this.clock.jumps;
  }

  /** Take in an answer: when it was asked and came on this page's clock, when it was received and sent on the console's. */
  add(page_sent_s, console_received_s, console_sent_s, page_received_s) {
    const trip_s = page_received_s - page_sent_s - (console_sent_s - console_received_s);
    if (trip_s < 0) return;
    const offset_s = (console_received_s - page_sent_s + (console_sent_s - page_received_s)) / 2;
    const sample = { offset_s, half_s: trip_s / 2, at_s: page_received_s };
    const excludes = (earlier) => Math.abs(earlier.offset_s - offset_s) > doubt(earlier, page_received_s) + sample.half_s + RESOLUTION_S;
    // Answers that exclude each other prove that a clock has jumped: the earlier ones are forgotten.
    if (this.samples.some(excludes)) this.samples = [];
    this.samples = [...this.samples, sample].slice(-WINDOW);
  }

  /** The console's time and how far it may be wrong; null while it has not been asked since the last sleep. */
  now() {
    const page_s = this.clock.now_s();
    if (this.clock.jumps !== this.jumps) this.forget();
    const best = this.samples.reduce((least, sample) => (least && doubt(least, page_s) <= doubt(sample, page_s) ? least : sample), null);
    return best && { now_s: page_s + best.offset_s, uncertainty_s: doubt(best, page_s) };
  }
}

/** How far an answer may be wrong by now. */
const doubt = ({ half_s, at_s }, now_s) => half_s + DRIFT_S_PER_S * Math.max(0, now_s - at_s);
