/* Showing a dialog that was made for the occasion: it is on top, goes with Escape alone, and gives the focus back. */

import { asked } from "./progress.js";

/** Show a dialog; resolves with its return value once it is closed and gone. `focus()` chooses what has the focus. */
export function showDialog(dialog, focus) {
  const opener = document.activeElement;
  const answered = asked();
  // A browser lets one Escape close several dialogs that were opened without a click in between: here it is one at a time.
  dialog.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.preventDefault();
    event.stopPropagation();
    dialog.close();
  });
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      answered();
      // The browser has given the focus back already, but to nothing where the opener is gone; this event comes a little later.
      if (document.activeElement === document.body) giveBack(opener);
      resolve(dialog.returnValue);
    });
    document.body.append(dialog);
    dialog.showModal();
    focus?.();
  });
}

/** Where the button that opened a dialog was drawn anew, or is gone, the keyboard does not lose its place. */
function giveBack(opener) {
  const key = opener?.dataset?.key;
  const target = opener?.isConnected ? opener : key && document.querySelector(`[data-key="${CSS.escape(key)}"]`);
  (target || document.getElementById("main"))?.focus();
}
