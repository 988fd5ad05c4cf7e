/* Publishing: the console checks the draft first; what it calls an error is shown, and published only by whoever says so. */

import { post } from "./api.js";
import { el } from "./dom.js";
import { sure } from "./form.js";

const SHOWN = 8;

/** Publish the draft and return the graph; null where somebody thought better of it. */
export async function publish() {
  try {
    return await post("/api/publish", {});
  } catch (error) {
    const { findings } = error.details;
    if (!findings) throw error;
    const yes = await sure({
      title: "Publish all the same?", yes: "Publish it", no: "Not yet",
      text: "Whoever is led by this version is led into what was found, or was never looked at:",
      extra: el("ul", { class: "changes" }, ...findings.slice(0, SHOWN).map(({ text, action }) => el("li", {}, el("b", {}, text), ` ${action}`)),
        findings.length > SHOWN ? el("li", {}, `and ${findings.length - SHOWN} more`) : null),
    });
    return yes ? post("/api/publish", { confirmed: true }) : null;
  }
}
