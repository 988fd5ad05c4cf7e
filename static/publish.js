/* Publishing: what the checker calls an error is shown first, and published only by whoever says so. */

import { post } from "./api.js";
import { sure } from "./form.js";

/** Publish the draft and return the graph; null where somebody thought better of it. */
export async function publish() {
  try {
    return await post("/api/publish", {});
  } catch (error) {
    if (error.status !== 409) throw error;
    const yes = await sure({
      title: "Publish all the same?", yes: "Publish it", no: "Not yet",
      text: `${error.message} Whoever is led by this version is led into what was found, or was never looked at.`,
    });
    return yes ? post("/api/publish", { confirmed: true }) : null;
  }
}
