/* Publishing: the console checks the draft first; what it calls an error is shown, and published only by whoever says so. */

import { post } from "./api.js";
import { el } from "./dom.js";
import { sure } from "./form.js";

const SHOWN = 8;

/** Publish the draft and return the graph; null where somebody thought better of it. Only the version whose errors were
 *  shown is confirmed: where the draft has changed meanwhile, the new one's are shown, and it is asked again. */
export async function publish() {
  let said = {};
  for (let again = false; ;) {
    try {
      return await post("/api/publish", said);
    } catch (error) {
      const { findings, version } = error.details;
      const isStale = error.status === 409 && "version" in said;
      if (!findings && !isStale) throw error;
      again ||= isStale;
      if (findings && !(await isWanted(findings, version, again))) return null;
      // Where the draft has changed under the confirmation, what it is now is checked first, as if nobody had confirmed anything.
      said = findings ? { confirmed: true, version } : {};
    }
  }
}

function isWanted(findings, version, again) {
  const meanwhile = again ? `The draft has been changed meanwhile, it is version ${version} by now. ` : "";
  return sure({
    title: again ? "Publish what it is now?" : "Publish all the same?", yes: "Publish it", no: "Not yet",
    text: `${meanwhile}Walkers would be led by this version as it is. The check says:`,
    extra: el("ul", { class: "changes" }, ...findings.slice(0, SHOWN).map(({ text, action }) => el("li", {}, el("b", {}, text), ` ${action}`)),
      findings.length > SHOWN ? el("li", {}, `and ${findings.length - SHOWN} more`) : null),
  });
}
