/* What stands where no page is. */

import { ready, start } from "./shell.js";

await start();
ready();
