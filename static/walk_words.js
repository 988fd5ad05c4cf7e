/* What past walks are told in: dates, durations, kinds of marks with a shape and a word each. */

import { decimals } from "./dom.js";

/** "1:07", "1:02:07"; with tenths where single cycles are told apart. */
export function clock(seconds, tenths = false) {
  const whole = tenths ? Math.floor(seconds + 1e-6) : Math.round(seconds);
  const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (value) => String(value).padStart(2, "0");
  const tenth = tenths ? `.${Math.min(9, Math.floor((seconds - whole) * 10 + 1e-6))}` : "";
  return hours ? `${hours}:${two(minutes)}:${two(rest)}${tenth}` : `${minutes}:${two(rest)}${tenth}`;
}

export const date = (at_s) => new Date(at_s * 1000).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
export const timeOfDay = (at_s) => new Date(at_s * 1000).toLocaleTimeString(undefined, { timeStyle: "medium" });

/** "0.21 m", or a dash where nothing is known. */
export function figure(value, unit, digits = 2) {
  return value === null || value === undefined ? "–" : `${decimals(value, digits)} ${unit}`;
}

/** Kinds of marks: a word, a shape (drawn in a box from -1 to 1), whether N and P stop at them, and whether they are shown only where there are some. */
export const MARKS = {
  alert: { words: "Alert", shape: "M0-1 1 .9H-1z", stops: true, rare: true },
  stop: { words: "Told to stop", shape: "M-.8-.8H.8V.8H-.8z", stops: true },
  weak: { words: "Position weak", shape: "M0-1 1 0 0 1-1 0z", stops: true },
  off_road: { words: "Off the road", shape: "M0-1 1 .8H-1z", stops: true },
  disagreement: { words: "Sonar and camera disagree", shape: "M-1-.8H1L0 1z", stops: true },
  order: { words: "Asked for", shape: "M-.3-1H.3V-.3H1V.3H.3V1H-.3V.3H-1V-.3H-.3z", stops: true },
  event: { words: "Event", shape: "M0-.8A.8.8 0 1 1 0 .8.8.8 0 1 1 0-.8z", stops: false },
  cue: { words: "Said", shape: "M-.25-1H.25V1H-.25z", stops: false },
};

const SVG = "http://www.w3.org/2000/svg";

export function svg(tag, properties = {}, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) if (value !== undefined && value !== null) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/** A small picture of a kind of mark, for legends and lists; the word stands beside it. */
export function markSign(kind) {
  return svg("svg", { viewBox: "-1.2 -1.2 2.4 2.4", class: "mark-sign", "aria-hidden": "true" }, svg("path", { d: MARKS[kind].shape, class: `mark-${kind}` }));
}
