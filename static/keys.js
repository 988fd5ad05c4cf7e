/* Keys of the pages: never where somebody types. */

const TYPED_INTO = "input:not([type=checkbox], [type=radio], [type=range], [type=file]), textarea, select";

export function isTyping(target) {
  return Boolean(target.closest?.(TYPED_INTO));
}

/** Ctrl+Z and Ctrl+Shift+Z (or Ctrl+Y) outside of text fields and dialogs. */
export function undoKeys(graph) {
  document.addEventListener("keydown", (event) => {
    if (isTyping(event.target) || document.querySelector("dialog[open]") || !(event.ctrlKey || event.metaKey)) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) graph.redo();
    else graph.undo();
  });
}
