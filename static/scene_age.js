/* How old the 3D scene is: the console writes its own time into the scene (console/viewer/live_layer.py), and this page reads what has
 * arrived there. A scene that stands still while the console goes on, or with it, never looks live; nor does one that shows a walker who was
 * heard of long ago. */

import { FRESHNESS, freshnessOf, showBadge } from "./live.js";
import { setText } from "./dom.js";

const BEAT = "/live/beat";

export class SceneAge {
  constructor(part, frame, badge) {
    Object.assign(this, { part, frame, badge });
  }

  /** Show the scene's age, or that of the walker in it where that is worse: `walker` is how fresh they are, null for none.
   *  `console_s` is the console's time now, null while it is not known. */
  show(limits, console_s, walker) {
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
    const worse = walker && RANKS.indexOf(walker.fresh) > RANKS.indexOf(fresh) ? walker : { fresh, age_s };
    return showBadge(this.badge, worse.fresh, worse.age_s);
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

const RANKS = Object.keys(FRESHNESS);
/** The beat itself comes once in a while. */
const BEAT_EVERY_S = 0.5;
const SCENE_LIMITS = ({ delayed, stale, lost }) => ({ delayed: delayed + BEAT_EVERY_S, stale: stale + BEAT_EVERY_S, lost: lost + BEAT_EVERY_S });
