/* Tabs as the WAI-ARIA pattern has them: arrows move, the tab that has the focus is shown. */

/** Make a list of tabs work; returns a function that chooses one by its id. */
export function tabs(list) {
  const all = [...list.querySelectorAll("[role=tab]")];
  const choose = (tab, focus) => {
    for (const other of all) {
      const chosen = other === tab;
      other.setAttribute("aria-selected", String(chosen));
      other.tabIndex = chosen ? 0 : -1;
      document.getElementById(other.getAttribute("aria-controls")).hidden = !chosen;
    }
    if (focus) tab.focus();
  };
  for (const [index, tab] of all.entries()) {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1, Home: -index, End: all.length - 1 - index }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      choose(all[(index + step + all.length) % all.length], true);
    });
  }
  return (id) => {
    const tab = all.find((one) => one.id === id);
    if (tab) choose(tab);
  };
}
