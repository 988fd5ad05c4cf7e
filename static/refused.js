/* What stands where a page is that the role of whoever asks does not open. */

import { $, setText } from "./dom.js";
import { ready, start } from "./shell.js";

const { role } = await start();
setText($("why"), `You are signed in as ${role}, and your role does not open this page. The pages that it opens are above; an admin can give you another role.`);
ready();
