/* Why the walker is told what they are told: a sentence, a picture from above, and the checks one by one.

   The picture shows the floor round the walker, who looks up the page. Every mark has a shape of its own, and what is
   not known is hatched: colour says nothing alone. Nodes are made once; with each decision only attributes change. */

import { ago, el, metres, setText } from "./dom.js";
import { toast } from "./toast.js";

const SVG = "http://www.w3.org/2000/svg";
const PER_M = 50;
const FAR_M = 4.4;
const ASIDE_M = 3.2;
const BEHIND_M = 1.7;
const RINGS_M = [1, 2, 3, 4];
/** Beside what the camera sees. */
const RING_LABELS_RAD = (-46 * Math.PI) / 180;
/** Neighbouring bearings whose distances differ by less show one thing. */
const SAME_THING_M = 0.35;
const FREE = 0, OBSTACLE = 1, DROP = 2, UNKNOWN = 3, HEARD = 4;
const MARK_EVERY_RAD = Math.PI / 45;
const SAME_INSTANT_S = 0.15;
const SEEN_RAD = Math.PI / 4, SEEN_STEP_RAD = Math.PI / 60;
const SEEN_COUNT = Math.round((2 * SEEN_RAD) / SEEN_STEP_RAD) + 1;
/** Where nothing was looked at, all that the camera would see is not known: an empty picture would look free. */
const NOT_LOOKED = {
  first_rad: -SEEN_RAD, step_rad: SEEN_STEP_RAD, states: Array(SEEN_COUNT).fill(UNKNOWN), nearest_cm: Array(SEEN_COUNT).fill(0),
};
const SILENT = { no_echo: "sonar: no echo", stale: "sonar: silent", absent: "no sonar" };
const LEGEND = [
  ["free", "seen to be free", "M2 12 L4 2 H14 L16 12 Z"],
  ["unknown", "not known", "M2 12 L4 2 H14 L16 12 Z"],
  ["edge", "something there", "M2 8 Q9 2 16 8"],
  ["drop", "floor falls away", "M3 3 H15 L9 12 Z"],
  ["heard", "only heard", "M9 1 L15 7 L9 13 L3 7 Z"],
  ["unseen", "remembered, out of view", "M5 3 H13 V11 H5 Z"],
  ["walkable", "free far enough", "M9 12 V5 M6.500 3.500 a2.500 2.500 0 1 0 5 0 a2.500 2.500 0 1 0 -5 0"],
  ["narrow", "not free far enough", "M9 12 V6 M7 4 H11"],
  ["expected", "θ_exp, where the way leads", "M9 13 V1"],
  ["chosen", "direction that is told", "M9 13 V5 M4 7 L9 1 L14 7 Z"],
  ["optimal", "θ_opt, where it is not walked", "M9 13 V5 M4 7 L9 1 L14 7 Z"],
  ["goal", "sub-goal, with its case", "M9 2 a5 5 0 1 0 .01 0 Z"],
  ["cone", "sonar’s field, up to its echo", "M9 13 L4 3 Q9 0 14 3 Z"],
  ["gate", "an echo must be beyond", "M3 9 Q9 4 15 9"],
  ["required", "must be free up to here", "M1 10 Q9 0 17 10"],
  ["stop-ring", "nothing may be nearer", "M4 10 Q9 4 14 10"],
  ["corridor", "walker’s width", "M5 13 V1 M13 13 V1"],
];
let count = 0;

export class TracePanel {
  /** `root` is an empty element; everything in it is made here. */
  constructor(root) {
    this.root = root;
    this.id = `trace-${++count}`;
    this.view = null;
    this.drawn = "";
    this.empty = el("p", { class: "empty" }, "There is no decision to show yet.");
    this.sentence = el("p", { class: "trace-sentence", id: `${this.id}-sentence` });
    this.age = el("p", { class: "quiet small number" });
    this.picture = new PolarPlot(`${this.id}-hatch`, this.sentence.id);
    this.depth = new DepthPicture();
    this.steps = new Steps();
    const copy = el("button", { type: "button", class: "slim", onclick: () => copied(this.text()) }, "Copy as text");
    this.filled = el("div", { class: "trace stack", hidden: true },
      el("div", { class: "fades" }, this.sentence, this.age),
      el("div", { class: "trace-pictures fades" }, this.picture.node, this.depth.node),
      legend(this.picture.hatch), this.steps.node, copy);
    root.append(this.empty, this.filled);
  }

  /** Show a device, as data of the live stream or of a past walk; null for none. */
  show(view, { elapsed_s = 0, fresh = view?.freshness } = {}) {
    this.view = view?.state ? view : null;
    this.empty.hidden = this.view !== null;
    this.filled.hidden = this.view === null;
    if (this.view === null || !this.root.checkVisibility()) return;
    this.filled.dataset.freshness = fresh;
    const { trace } = this.view.state;
    setText(this.age, `Decided ${ago(view.age_s === null ? null : view.age_s + elapsed_s)}`);
    this.depth.show(this.view);
    const key = `${view.id} ${trace.stamp_s}`;
    if (key === this.drawn) return;
    this.drawn = key;
    setText(this.sentence, trace.sentence);
    this.picture.show(this.view.state);
    this.steps.show(trace.steps);
  }

  /** The decision as plain text: device and time, the sentence, and each check. */
  text() {
    if (this.view === null) return "";
    const { trace } = this.view.state;
    const steps = trace.steps.map(({ name, found, outcome }) => `${name}: ${found}${outcome ? ` [${outcome}]` : ""}`);
    return [`${this.view.name}, at ${trace.stamp_s.toFixed(2)} s of its clock`, trace.sentence, ...steps].join("\n");
  }
}

/* --------------------------------------------------------------------------------------------------- the picture */
class PolarPlot {
  constructor(hatchId, describedBy) {
    this.hatch = hatchId;
    const box = [-ASIDE_M, -FAR_M, 2 * ASIDE_M, FAR_M + BEHIND_M].map((each) => each * PER_M);
    this.node = svg("svg", {
      viewBox: box.join(" "), class: "polar", role: "img", "aria-describedby": describedBy,
      "aria-label": "What is round the walker, seen from above; ahead is up",
    });
    const pattern = svg("pattern", { id: hatchId, width: 8, height: 8, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
    pattern.append(svg("rect", { width: 8, height: 8, class: "hatch-ground" }), svg("path", { d: "M0 0V8", class: "hatch-line" }));
    const defs = svg("defs", {});
    defs.append(pattern);
    this.node.append(defs);
    const path = (name) => this.add("path", { class: name });
    this.free = path("free");
    this.unknown = path("unknown");
    this.unknown.setAttribute("fill", `url(#${hatchId})`);
    for (const radius_m of RINGS_M) this.add("circle", { class: "ring", r: radius_m * PER_M });
    this.add("path", { class: "ring", d: `M0 0V${-FAR_M * PER_M}` });
    for (const name of ["corridor", "cone", "narrow", "walkable", "edge"]) this[name] = path(name);
    for (const radius_m of RINGS_M) {
      const [x, y] = xy(RING_LABELS_RAD, radius_m);
      text(this.add("text", { class: "ring-label", x, y }), `${radius_m} m`);
    }
    for (const name of ["required", "gate", "echo", "drop", "heard", "unseen", "expected", "optimal", "turning", "chosen"]) this[name] = path(name);
    this.stopRing = path("stop-ring");
    this.goal = this.add("circle", { class: "goal", r: 9 });
    this.goalCase = this.add("text", { class: "goal-case" });
    this.labels = {};
    for (const name of ["required", "expected", "told", "echo", "goal"]) this.labels[name] = this.add("text", { class: `label label-${name}` });
    this.walker = this.add("path", { class: "walker", d: "M0 -13 L9 9 L0 5 L-9 9 Z" });
    this.halt = this.add("path", { class: "halt", d: "M-6 -14 H6 L14 -6 V6 L6 14 H-6 L-14 6 V-6 Z M-5 -5 H5 V5 H-5 Z" });
  }

  add(tag, attributes) {
    const node = svg(tag, attributes);
    this.node.append(node);
    return node;
  }

  show(state) {
    const { trace } = state;
    this.showScan(trace.scan);
    this.showCandidates(trace.candidates);
    this.showLimits(trace, state);
    this.showSonar(trace, state);
    this.showDirections(trace, state);
    this.showGoal(trace);
    this.moveLabelsApart();
    shown(this.halt, state.action === "stop");
    shown(this.walker, state.action !== "stop");
  }

  showScan(scan) {
    const { states, nearest_cm, first_rad, step_rad } = scan?.states.length ? scan : NOT_LOOKED;
    const unseen = scan?.unseen ?? [];
    const parts = { free: "", unknown: "", edge: "", drop: "", heard: "" };
    // Neighbours closer than their marks are wide share one.
    let marked_rad = -Infinity;
    states.forEach((state, index) => {
      const from = first_rad + (index - 0.5) * step_rad, to = from + step_rad, middle = from + step_rad / 2;
      const near_m = Math.min(nearest_cm[index] / 100, FAR_M);
      if (state === UNKNOWN) parts.unknown += sector(from, to, FAR_M);
      else parts.free += sector(from, to, state === FREE ? FAR_M : near_m);
      if (state === FREE || state === UNKNOWN || nearest_cm[index] / 100 > FAR_M) return;
      const before_m = index > 0 && states[index - 1] === state ? nearest_cm[index - 1] / 100 : Infinity;
      // A line goes on only from what is drawn: one bad step, and the browser draws nothing of it.
      const goesOn = before_m <= FAR_M && Math.abs(before_m - near_m) < SAME_THING_M;
      parts.edge += goesOn ? `L${at(middle, near_m)}` : `M${at(from, near_m)}L${at(middle, near_m)}`;
      if (state === OBSTACLE || middle - marked_rad < MARK_EVERY_RAD) return;
      marked_rad = middle;
      if (state === DROP) parts.drop += triangle(middle, near_m);
      if (state === HEARD) parts.heard += diamond(middle, near_m);
    });
    for (const [name, d] of Object.entries(parts)) this[name].setAttribute("d", d);
    this.unseen.setAttribute("d", unseen.map(([degrees, cm]) => square((degrees * Math.PI) / 180, cm / 100)).join(""));
  }

  showCandidates(candidates) {
    let walkable = "", narrow = "";
    for (const [angle_rad, clearance_m, isWalkable] of candidates) {
      const [x, y] = xy(angle_rad, Math.min(clearance_m, FAR_M - 0.1));
      const [x0, y0] = xy(angle_rad, Math.min(0.6, clearance_m));
      if (isWalkable) walkable += `M${f(x0)} ${f(y0)}L${f(x)} ${f(y)}M${f(x - 3)} ${f(y)}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`;
      else narrow += `M${f(x0)} ${f(y0)}L${f(x)} ${f(y)}M${f(x - 3)} ${f(y)}h6`;
    }
    this.walkable.setAttribute("d", walkable);
    this.narrow.setAttribute("d", narrow);
  }

  showLimits({ required_m, limits, optimal_rad }, { direction_rad }) {
    arcAt(this.required, required_m, 0, Math.PI / 3);
    arcAt(this.stopRing, limits.stop_m, 0, Math.PI / 3);
    this.label("required", required_m === null ? "" : `δ ${metres(required_m)}`, Math.PI / 3, required_m ?? 0);
    const half_m = limits.person_width_m / 2, along_m = Math.min(required_m ?? limits.clearance_m, FAR_M);
    const towards_rad = direction_rad ?? optimal_rad ?? 0;
    const sides = [half_m, -half_m].map((aside_m) => `M${beside(towards_rad, 0, aside_m)}L${beside(towards_rad, along_m, aside_m)}`);
    this.corridor.setAttribute("d", half_m > 0 ? sides.join("") : "");
  }

  showSonar({ sonar_rad, limits }, { sonar_state, sonar_m }) {
    const half_rad = limits.half_field_rad;
    const hears = half_rad > 0 && (sonar_state === "ok" || sonar_state === "no_echo") && sonar_m !== null;
    const reach_m = hears ? Math.min(sonar_m, FAR_M) : 0;
    this.cone.setAttribute("d", hears ? sector(sonar_rad - half_rad, sonar_rad + half_rad, reach_m) : "");
    this.cone.classList.toggle("silent", sonar_state !== "ok");
    arcAt(this.echo, hears && sonar_state === "ok" ? sonar_m : null, sonar_rad, half_rad);
    arcAt(this.gate, half_rad > 0 ? limits.gate_m : null, sonar_rad, 2 * half_rad);
    const words = sonar_state === "ok" ? `sonar ${metres(sonar_m)}` : SILENT[sonar_state];
    this.label("echo", words, Math.PI, BEHIND_M - 0.25);
  }

  showDirections({ expected_rad, optimal_rad, look_rad }, { action, direction_rad }) {
    this.expected.setAttribute("d", expected_rad === null ? "" : `M${at(expected_rad, 0.3)}L${at(expected_rad, FAR_M - 0.15)}`);
    this.label("expected", expected_rad === null ? "" : "θ_exp", expected_rad ?? 0, FAR_M - 0.3);
    const told_rad = action === "stop" ? null : direction_rad;
    const length_m = action === "turn" ? 1.3 : 1.9;
    this.chosen.setAttribute("d", told_rad === null ? "" : arrow(told_rad, length_m));
    this.turning.setAttribute("d", action === "turn" && told_rad !== null ? bend(told_rad, 0.8) : "");
    const other_rad = told_rad === null ? optimal_rad ?? look_rad : null;
    this.optimal.setAttribute("d", other_rad === null ? "" : arrow(other_rad, 1.9));
    const name = action === "walk" ? "θ_walk" : action === "turn" ? "turn" : optimal_rad === null ? "look" : "θ_opt";
    const shown_rad = told_rad ?? other_rad;
    this.label("told", shown_rad === null ? "" : `${name} ${degrees(shown_rad)}`, shown_rad ?? 0, length_m + 0.25);
  }

  showGoal({ sub_goal, sub_goal_case }) {
    shown(this.goal, sub_goal !== null);
    text(this.goalCase, sub_goal === null ? "" : String(sub_goal_case ?? ""));
    if (sub_goal === null) return this.label("goal", "", 0, 0);
    const limit_m = Math.cos(sub_goal.bearing_rad) < 0 ? BEHIND_M - 0.3 : FAR_M - 0.3;
    const aside_m = (ASIDE_M - 0.3) / Math.max(Math.abs(Math.sin(sub_goal.bearing_rad)), 1e-6);
    const [x, y] = xy(sub_goal.bearing_rad, Math.min(sub_goal.distance_m, limit_m, aside_m));
    place(this.goal, { cx: x, cy: y });
    place(this.goalCase, { x, y: y + 4 });
    const [lx, ly] = [x > ASIDE_M * PER_M - 60 ? x - 14 : x + 14, y + 4];
    place(this.labels.goal, { x: lx, y: ly, "text-anchor": lx < x ? "end" : "start" });
    text(this.labels.goal, metres(sub_goal.distance_m));
    return undefined;
  }

  /** Where bearings lie close together so do their words: those lower in the picture move down. */
  moveLabelsApart() {
    const labels = Object.values(this.labels).filter((label) => label.textContent);
    const tops = apart(labels.map((label) => labelBox(label)));
    labels.forEach((label, index) => place(label, { y: tops[index] + LABEL_PX }));
  }

  label(name, words, bearing_rad, distance_m) {
    const [x, y] = xy(bearing_rad, distance_m);
    const side = Math.abs(x) < 20 ? "middle" : x > 0 ? "end" : "start";
    const edge = ASIDE_M * PER_M - 6;
    place(this.labels[name], { x: Math.max(-edge, Math.min(edge, x)), y: Math.max(-FAR_M * PER_M + 14, y), "text-anchor": side });
    text(this.labels[name], words);
  }
}

const LABEL_PX = 13;
const LETTER_PX = 6.6;

function labelBox(label) {
  const [x, y] = ["x", "y"].map((name) => Number(label.getAttribute(name)));
  const width = LETTER_PX * label.textContent.length;
  const left = { start: x, middle: x - width / 2, end: x - width }[label.getAttribute("text-anchor")];
  return { left, right: left + width, top: y - LABEL_PX };
}

/** Return the tops of boxes of one line each, {left, right, top}, moved down until none lies over another; the highest stays. */
export function apart(boxes) {
  const tops = boxes.map(({ top }) => top);
  const placed = [];
  for (const index of [...boxes.keys()].sort((a, b) => tops[a] - tops[b])) {
    const { left, right } = boxes[index];
    const beside = placed.filter((other) => boxes[other].left < right && left < boxes[other].right).sort((a, b) => tops[a] - tops[b]);
    for (const other of beside) if (Math.abs(tops[other] - tops[index]) < LABEL_PX) tops[index] = tops[other] + LABEL_PX;
    placed.push(index);
  }
  return tops;
}

/* ------------------------------------------------------------------------------------------------ depth and steps */
class DepthPicture {
  constructor() {
    this.image = el("img", { alt: "Depth silhouette: near things are bright" });
    this.caption = el("figcaption", {});
    this.node = el("figure", { class: "depth", hidden: true }, this.image, this.caption);
    this.key = "";
  }

  show(view) {
    this.node.hidden = view.depth_stamp_s === null;
    if (this.node.hidden) return;
    const older_s = view.state.trace.stamp_s - view.depth_stamp_s;
    const dated = Math.abs(older_s) <= SAME_INSTANT_S ? "the same instant"
      : `${Math.abs(older_s).toFixed(1)} s ${older_s > 0 ? "before" : "after"} this decision`;
    setText(this.caption, dated);
    const url = view.depth_url ?? `/api/devices/${encodeURIComponent(view.id)}/depth.jpg?at=${view.depth_stamp_s}`;
    if (url === this.key) return;
    this.key = url;
    this.image.src = url;
  }
}

class Steps {
  constructor() {
    this.rows = [];
    this.body = el("tbody", {});
    this.node = el("details", { class: "trace-steps" }, el("summary", {}, "Step by step, with figures"),
      el("table", {}, el("thead", {}, el("tr", {}, ...["Looked at", "Found", "Gave"].map((name) => el("th", { scope: "col" }, name)))), this.body));
  }

  show(steps) {
    while (this.rows.length < steps.length) {
      const cells = [el("th", { scope: "row" }), el("td", {}), el("td", {})];
      this.rows.push({ cells, row: el("tr", {}, ...cells) });
      this.body.append(this.rows[this.rows.length - 1].row);
    }
    this.rows.forEach(({ cells, row }, index) => {
      const step = steps[index];
      row.hidden = step === undefined;
      if (step === undefined) return;
      setText(cells[0], step.name);
      setText(cells[1], step.found);
      setText(cells[2], step.outcome);
      row.classList.toggle("decides", step.decides);
      row.classList.toggle("skipped", step.outcome === "not reached");
    });
  }
}

function legend(hatchId) {
  const items = LEGEND.map(([name, words, d]) => {
    const picture = svg("svg", { viewBox: "0 0 18 14", class: "swatch", "aria-hidden": "true" });
    const path = svg("path", { class: name, d });
    if (name === "unknown") path.setAttribute("fill", `url(#${hatchId})`);
    picture.append(path);
    return el("li", {}, picture, words);
  });
  return el("details", { class: "trace-legend" }, el("summary", {}, "What the marks mean"), el("ul", {}, ...items));
}

async function copied(words) {
  try {
    await navigator.clipboard.writeText(words);
    toast("The decision is copied.");
  } catch {
    toast("This browser does not let the page copy: open “Step by step”, and copy from there.");
  }
}

/* --------------------------------------------------------------------------------------------------------- drawing */
function svg(tag, attributes) {
  const node = document.createElementNS(SVG, tag);
  place(node, attributes);
  return node;
}

function place(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, typeof value === "number" ? f(value) : value);
}

const text = setText;
const shown = (node, isShown) => node.classList.toggle("away", !isShown);
const f = (value) => String(Math.round(value * 10) / 10);

/** Where a bearing (to the left) and a distance are in the picture. */
function xy(bearing_rad, distance_m) {
  return [-Math.sin(bearing_rad) * distance_m * PER_M, -Math.cos(bearing_rad) * distance_m * PER_M];
}

const at = (bearing_rad, distance_m) => xy(bearing_rad, distance_m).map(f).join(" ");

/** A place so far along a direction, and so far to the left of it. */
function beside(direction_rad, along_m, aside_m) {
  const [x, y] = xy(direction_rad, along_m);
  const [sx, sy] = xy(direction_rad + Math.PI / 2, aside_m);
  return `${f(x + sx)} ${f(y + sy)}`;
}

const sector = (from_rad, to_rad, radius_m) => `M0 0L${at(from_rad, radius_m)}L${at(to_rad, radius_m)}Z`;

function arcAt(path, radius_m, middle_rad, half_rad) {
  const drawn = radius_m !== null && radius_m !== undefined && radius_m > 0 && radius_m <= FAR_M;
  const r = f((radius_m ?? 0) * PER_M);
  path.setAttribute("d", drawn ? `M${at(middle_rad + half_rad, radius_m)}A${r} ${r} 0 0 1 ${at(middle_rad - half_rad, radius_m)}` : "");
}

function arrow(bearing_rad, length_m) {
  const tip = at(bearing_rad, length_m);
  const wings = [0.16, -0.16].map((aside_m) => beside(bearing_rad, length_m - 0.32, aside_m));
  return `M${at(bearing_rad, 0.3)}L${at(bearing_rad, length_m - 0.32)}M${wings[0]}L${tip}L${wings[1]}Z`;
}

/** An arc from straight ahead to where is turned. */
function bend(bearing_rad, radius_m) {
  const r = f(radius_m * PER_M);
  return `M${at(0, radius_m)}A${r} ${r} 0 0 ${bearing_rad > 0 ? 0 : 1} ${at(bearing_rad, radius_m)}`;
}

function around(bearing_rad, distance_m, points) {
  const [x, y] = xy(bearing_rad, distance_m);
  return `M${points.map(([dx, dy]) => `${f(x + dx)} ${f(y + dy)}`).join("L")}Z`;
}
const triangle = (bearing_rad, distance_m) => around(bearing_rad, distance_m, [[-6, -5], [6, -5], [0, 6]]);
const diamond = (bearing_rad, distance_m) => around(bearing_rad, distance_m, [[0, -7], [7, 0], [0, 7], [-7, 0]]);
const square = (bearing_rad, distance_m) => around(bearing_rad, distance_m, [[-2, -2], [2, -2], [2, 2], [-2, 2]]);

function degrees(angle_rad) {
  const whole = Math.round((angle_rad * 180) / Math.PI);
  return whole === 0 ? "ahead" : `${Math.abs(whole)}° ${whole > 0 ? "left" : "right"}`;
}
