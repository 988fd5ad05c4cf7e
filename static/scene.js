/* Showing something in the 3D scene: in the one that is open, else on the page Console, which is opened for it. */

import { post } from "./api.js";
import { attempt, toast } from "./toast.js";

const KEPT = "show-in-scene";
const ASK_AGAIN_MS = 500;
const PATIENCE_MS = 60_000;

/** Ask the scene for `wanted`, as POST /api/view takes it; where no scene is open, the page Console is opened and asks its own. */
export function showInScene(wanted) {
  return attempt(async () => {
    const { scenes } = await post("/api/view", wanted);
    if (scenes) return toast("The scene shows it.");
    sessionStorage.setItem(KEPT, JSON.stringify(wanted));
    return location.assign("/");
  });
}

/** On the page Console: show what another page has asked for, as soon as the scene is up. */
export async function showWhatWasAsked() {
  const wanted = sessionStorage.getItem(KEPT);
  if (!wanted) return;
  sessionStorage.removeItem(KEPT);
  const end = performance.now() + PATIENCE_MS;
  await attempt(async () => {
    while (!(await post("/api/view", JSON.parse(wanted))).scenes) {
      if (performance.now() > end) throw new Error("The scene is still loading: go back, and try again in a moment.");
      await new Promise((resolve) => { setTimeout(resolve, ASK_AGAIN_MS); });
    }
  }, "The scene is loading…");
}
