/* The checker of the draft, as the console runs it: begun here, followed until it is done. */

import { getIfThere, post } from "./api.js";

const ASK_EVERY_MS = 400;

/** What a finding's severity is called and drawn as. */
export const SEVERITIES = {
  error: { kind: "bad", mark: "✕", one: "error", many: "errors", title: "Errors: somebody cannot be led safely, or at all" },
  warning: { kind: "warn", mark: "▲", one: "warning", many: "warnings", title: "Warnings: look at these" },
  note: { kind: "info", mark: "●", one: "note", many: "notes", title: "Notes: this may be wanted" },
};

/** "2 errors"; empty for none. */
export function severityCount(findings, severity) {
  const count = findings.filter((finding) => finding.severity === severity).length;
  return count ? `${count} ${count === 1 ? SEVERITIES[severity].one : SEVERITIES[severity].many}` : "";
}

export class Checker {
  /** `show()` is called at each change of `state`, the console's answer {stage: none|running|done|failed, percent, version, findings,
   *  sentence}; `isThere` is false where it has no checker. */
  constructor(show) {
    this.show = show;
    this.state = { stage: "none", version: null, findings: [], sentence: "" };
    this.isThere = false;
    this.timer = null;
  }

  get isRunning() {
    return this.state.stage === "running";
  }

  async look() {
    this.take(await getIfThere("/api/check"));
  }

  async begin() {
    this.take(await post("/api/check"));
  }

  take(answer) {
    this.isThere = answer !== null;
    if (answer !== null) this.state = answer;
    this.show();
    clearTimeout(this.timer);
    if (this.isRunning) this.timer = setTimeout(() => this.look().catch(() => this.again()), ASK_EVERY_MS);
  }

  /** The console is silent for the moment: ask again. */
  again() {
    this.timer = setTimeout(() => this.look().catch(() => this.again()), 5 * ASK_EVERY_MS);
  }
}
