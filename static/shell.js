/* What all pages share: who is signed in, the way out, and the pages a role may see. */

import { get, signOut } from "./api.js";
import { $, setText } from "./dom.js";
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
  $("sign-out").addEventListener("click", () => attempt(signOut));
  return { ...session, mayEdit: EDITING.includes(session.role), mayTune: TUNING.includes(session.role) };
}
