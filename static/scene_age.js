/* How old the 3D scene is: the console writes its own time into the scene (console/viewer/live_layer.py), and this page reads what has
 * arrived there. A scene that stands still while the console goes on, or with it, never looks live. */

import { freshnessOf, showBadge } from "./live.js";
import { setText } from "./dom.js";

const BEAT = "/live/beat";

export class SceneAge {
  constructor(part, frame, badge) {
    Object.assign(this, { part, frame, badge });
  }

  /** Show the scene's age; `console_s` is the console's time now, null while it is not known. */
  show(limits, console_s) {
    const beat_s = this.beat_s;
    if (beat_s === null || console_s === null) {
      this.part.dataset.freshness = beat_s === null ? "lost" : "delayed";
      this.badge.className = "badge";
      this.badge.dataset.mark = "○";
      return setText(this.badge, beat_s === null ? "Scene: not there yet" : "Scene: of unknown age");
    }
    const age_s = Math.max(0, console_s - beat_s);
    const fresh = freshnessOf(age_s, 0, true, SCENE_LIMITS(limits));
    this.part.dataset.freshness = fresh;
    return showBadge(this.badge, fresh, age_s);
  }

  /** The time that was last written into the scene, on the console's clock. */
  get beat_s() {
    try {
      const pose = this.frame.contentWindow.__viserMutable?.nodePoseData?.[BEAT];
      return pose?.position ? pose.position[0] : null;
    } catch {
      return null; // the frame shows an error of the browser's own
    }
  }
}

/** The beat itself comes once in a while. */
const BEAT_EVERY_S = 0.5;
const SCENE_LIMITS = ({ delayed, stale, lost }) => ({ delayed: delayed + BEAT_EVERY_S, stale: stale + BEAT_EVERY_S, lost: lost + BEAT_EVERY_S });
