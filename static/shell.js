/* What all pages share: who is signed in, the way out, and the pages a role may see. */

import { get, signOut } from "./api.js";
import { $, el, setText } from "./dom.js";
import { attempt } from "./toast.js";

const EDITING = ["editor", "admin"];
const TUNING = ["technician", "admin"];

/** Fill the header and return who is signed in, with what the role may do (the console checks it again). */
export async function start() {
  const session = await get("/api/session");
  setText($("site-name"), session.site);
  setText($("user-name"), session.name);
  setText($("user-role"), session.role);
  $("nav-admin").hidden = session.role !== "admin";
  $("nav-map-walks").hidden = !(EDITING.includes(session.role) || TUNING.includes(session.role));
  $("sign-out").addEventListener("click", () => attempt(signOut));
  return { ...session, mayEdit: EDITING.includes(session.role), mayTune: TUNING.includes(session.role) };
}

/** The page is whole: until now nothing on it could be pressed, for nothing would have happened. */
export function ready() {
  removeEventListener("error", sayItFailed);
  document.body.inert = false;
}

function sayItFailed({ error, message }) {
  const again = el("button", { type: "button", onclick: () => location.reload() }, "Load it again");
  $("main").prepend(el("p", { class: "note bad", role: "alert" }, `This page could not be started. ${error?.message ?? message} `, again));
  ready();
}

addEventListener("error", sayItFailed);
