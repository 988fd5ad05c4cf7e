/* What was seen of one device in the last two minutes, by the time of its capture: a ring that a page fills from the stream. */

export const SPAN_S = 120;
const MOST = 2600;
const SAME_S = 0.02;

export class History {
  constructor() {
    this.device = null;
    this.samples = [];
  }

  /** Take in what a device said of an instant `at_s` (console's clock). Returns the sample where it is a new one, else null. */
  add(device, at_s, values) {
    if (device !== this.device) this.samples = [];
    this.device = device;
    const last = this.samples.at(-1);
    // The clocks are compared ever better, so one instant may come twice at slightly different times.
    if (last && at_s <= last.at_s + SAME_S) {
      if (at_s < last.at_s - SPAN_S) this.samples = [];
      else return null;
    }
    const sample = { at_s, ...values };
    this.samples.push(sample);
    const first = this.samples.findIndex((each) => each.at_s >= at_s - SPAN_S);
    this.samples.splice(0, Math.max(first, this.samples.length - MOST));
    return sample;
  }
}

/** A quantity as lines of points [seconds before now, value]: where nothing was seen for `gap_s`, or nothing is known (null), a line ends;
 *  what is not measured (undefined) is passed over. Of what falls into one step only the `most` is kept, so that no peak is lost. */
export function lines(samples, key, now_s, { gap_s = 1.5, step_s = 0.5, most = Math.max } = {}) {
  const found = [];
  let line = null;
  let before_s = -Infinity;
  for (const sample of samples) {
    const { at_s, [key]: value } = sample;
    if (at_s < now_s - SPAN_S || value === undefined) continue;
    if (value === null) {
      line = null;
      continue;
    }
    const step = Math.floor(at_s / step_s);
    if (line === null || at_s - before_s > gap_s) found.push(line = []);
    const last = line.at(-1);
    if (last && last.step === step) last.value = most(last.value, value);
    else line.push({ step, before_s: now_s - at_s, value });
    before_s = at_s;
  }
  return found.map((each) => each.map(({ before_s: ago_s, value }) => [ago_s, value]));
}
