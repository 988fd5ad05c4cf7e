/* Making and changing elements; text is always text, never markup. */

export const $ = (id) => document.getElementById(id);

/** Make an element: el("button", {class: "primary", onclick: f}, "Save"). */
export function el(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "value") node.value = value;
    else if (value === true) node.setAttribute(name, "");
    else node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

/** Set a text, and touch the document only where it differs: a screen reader hears what is new, and once. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Call `draw` when the data differ from those of the last call: what somebody has the focus in is left alone. */
export function onChange(draw) {
  let last;
  return (data) => {
    const key = JSON.stringify(data);
    if (key === last) return;
    last = key;
    draw(data);
  };
}

/** A row of a table whose rows become cards on a phone: laid out so, table, rows and cells are such only where they say it. */
export function tableRow(...cells) {
  for (const cell of cells) cell.setAttribute("role", cell.tagName === "TH" ? "rowheader" : "cell");
  return el("tr", { role: "row" }, ...cells);
}

const PATHS = {
  walk: "M12 21V4 M5.5 10.5 12 4l6.5 6.5",
  left: "M20 20v-7a5 5 0 0 0-5-5H4 M9.5 2.5 4 8l5.5 5.5",
  right: "M4 20v-7a5 5 0 0 1 5-5h11 M14.5 2.5 20 8l-5.5 5.5",
  stop: "M7 7h10v10H7z",
  arrived: "M5 13l4.5 4.5L19 7",
  ready: "M6 12h.01 M12 12h.01 M18 12h.01",
  off_duty: "M12 3v8 M7 6.500a8 8 0 1 0 10 0",
  mapping: "M4 19V7l5-3 6 3 5-3v12l-5 3-6-3z M9 4v12 M15 7v12",
  localizing: "M11 4a7 7 0 1 0 0 14 7 7 0 0 0 0-14z M16 16l5 5",
  lost: "M8 9a4 4 0 1 1 5.500 3.700c-1 .5-1.500 1-1.500 2.300 M12 19h.01",
  fault: "M12 4v10 M12 19h.01",
  paused: "M9 6v12 M15 6v12",
  play: "M8 5v14l11-7z",
  fly: "M12 2v4 M12 18v4 M2 12h4 M18 12h4 M12 8.5a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7z",
  edit: "M4 20h4L19 9l-4-4L4 16z",
  remove: "M4 7h16 M9 7V4h6v3 M6.5 7l1 13h9l1-13",
  undo: "M4 9h10a6 6 0 0 1 0 12H9 M8 4.5 3.5 9 8 13.5",
  redo: "M20 9H10a6 6 0 0 0 0 12h5 M16 4.5 20.500 9 16 13.500",
};

/** Return a drawn sign; it says nothing to a screen reader, so a text must stand beside it. */
export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}

export function badge(kind, mark, text) {
  return el("span", { class: `badge ${kind}`, "data-mark": mark }, text);
}

const COMMAND_STATES = {
  sent: ["info", "…", "sent"], running: ["good", "✓", "accepted"], refused: ["bad", "✕", "refused"],
  unanswered: ["warn", "○", "not answered"],
};

/** What became of something that was asked of a device. */
export function commandBadge(state) {
  return badge(...COMMAND_STATES[state]);
}

/** A number with so many digits after the point; nothing is never "-0.00". */
export function decimals(value, digits = 2) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** "3.2 m", or a dash where there is nothing. */
export function metres(value, digits = value < 9.95 ? 1 : 0) {
  return value === null || value === undefined ? "–" : `${decimals(value, digits)} m`;
}

/** "now", "4 s ago", "3 min ago". */
export function ago(age_s) {
  if (age_s === null || age_s === undefined) return "";
  if (age_s < 1) return "now";
  if (age_s < 90) return `${Math.round(age_s)} s ago`;
  if (age_s < 5400) return `${Math.round(age_s / 60)} min ago`;
  return age_s < 172800 ? `${Math.round(age_s / 3600)} h ago` : `${Math.round(age_s / 86400)} days ago`;
}
