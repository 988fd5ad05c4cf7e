/* The page Overview: all walkers at once. The stream tells what differs; what is drawn anew is what differs on the screen. */

import { AlertList } from "./alerts.js";
import { attention, byNeed } from "./attention.js";
import { $, badge, el, icon, metres, onChange, setText } from "./dom.js";
import { doubt, freshnessOfDevice, isPast, listen, showBadge } from "./live.js";
import { OverviewRows } from "./overview-rows.js";
import { ready, start } from "./shell.js";
import { decision } from "./walker.js";

await start();
new AlertList($("alerts"), { most: 3 });
const known = new OverviewRows();
const { rows } = known;
const cards = new Map();
let now_s = 0;
let receivedAt_s = 0;
let limits = null;

listen(() => "/live/overview?says=1", {
  watching: () => [...rows.keys()],
  take(data, page_s) {
    now_s = data.now_s;
    receivedAt_s = page_s;
    limits = data.limits;
    known.take(data);
  },
  draw,
});
ready();

function draw(link) {
  const { least_s, most_s } = link.since(now_s, receivedAt_s);
  const doubt_s = most_s === null ? null : most_s - least_s;
  const seen = [...rows].map(([id, row]) => seenOf(id, row, now_s + least_s, doubt_s));
  $("no-devices").hidden = seen.length > 0 || known.isUnfolding;
  for (const one of seen) cardOf(one.id).show(one);
  for (const [id, card] of cards) if (!rows.has(id)) { card.node.remove(); cards.delete(id); }
  arrange(seen);
  showCounts({ all: seen.length, told: seen.filter(({ fresh }) => fresh !== "not_told").length, guided: seen.filter(({ rank }) => rank <= 6).length, need: seen.filter(({ rank }) => rank <= 5).length, linked: link.isLinked });
}

function seenOf(id, row, console_s, doubt_s) {
  const age_s = row.captured_s === null ? null : Math.max(0, console_s - row.captured_s);
  const fresh = freshnessOfDevice(row, age_s, doubt(row.uncertainty_s, doubt_s), limits);
  const [rank, why] = attention(row, fresh);
  return { id, row, age_s, fresh, rank, why, name: row.name };
}

/** Put the cards in order; while somebody points at one or has the focus there, none moves away below them. */
function arrange(seen) {
  const list = $("walkers");
  const missing = seen.some(({ id }) => !cards.get(id).node.isConnected);
  if (!missing && (list.matches(":hover") || list.contains(document.activeElement))) return;
  [...seen].sort(byNeed).forEach(({ id }, index) => {
    const { node } = cards.get(id);
    if (list.children[index] !== node) list.insertBefore(node, list.children[index] ?? null);
  });
}

const showCounts = onChange(({ all, told, guided, need, linked }) => {
  const known = [...told ? [`${guided} guided`, `${need} to look after`] : [], ...told < all ? ["…"] : []].join(", ");
  setText($("counts"), all ? `${all} ${all === 1 ? "walker" : "walkers"}, ${linked ? known : "all to look after: nothing is known of any of them"}` : "");
});

function cardOf(id) {
  if (!cards.has(id)) cards.set(id, new Card(id));
  return cards.get(id);
}

class Card {
  constructor(id) {
    this.sign = el("div", { class: "sign" });
    this.name = el("a", { class: "name", href: `/?device=${encodeURIComponent(id)}` });
    this.fresh = badge("", "○", "");
    this.action = el("p", { class: "action" });
    this.why = el("p", { class: "why" });
    this.alerts = el("p", { class: "walker-alerts", "data-device": id });
    this.facts = el("dl", { class: "walker-facts number" });
    this.node = el("li", { class: "walker", "data-id": id }, this.sign,
      el("div", { class: "walker-head" }, el("h2", {}, this.name), this.fresh), el("div", { class: "walker-what fades" }, this.action, this.why), this.alerts, this.facts);
    this.drawSign = onChange((name) => this.sign.replaceChildren(icon(name)));
    this.drawFacts = onChange((facts) => this.facts.replaceChildren(...facts.map(([term, words]) => el("div", {}, el("dt", {}, term), el("dd", {}, words)))));
  }

  show({ row, age_s, fresh, rank, why }) {
    const { node } = this;
    if (node.dataset.freshness !== fresh) node.dataset.freshness = fresh;
    const need = rank <= 2 ? "bad" : rank <= 5 ? "warn" : "";
    if (node.dataset.need !== need) node.dataset.need = need;
    setText(this.name, row.name);
    showBadge(this.fresh, fresh, age_s);
    const { sign, words } = whatIs(row, fresh);
    this.drawSign(sign);
    setText(this.action, words);
    setText(this.why, why || (isPast(fresh) ? "" : row.mode_sentence) || "");
    this.drawFacts(row.mode ? facts(row) : []);
  }
}

function whatIs(row, fresh) {
  if (fresh === "not_told") return { sign: "ready", words: "…" };
  return row.mode ? decision(row, row.destination, fresh) : { sign: "lost", words: "Has sent nothing yet" };
}

function facts(row) {
  return [
    ["Place", row.place || "not known"],
    ["To", row.destination ?? "nowhere"],
    ["Left", metres(row.remaining_m, 0)],
    ["Battery", row.battery_percent === null ? "not told" : `${row.battery_percent} %`],
    ["Link", row.link_delay_s === null ? "–" : `${Math.max(1, Math.round(row.link_delay_s * 1000))} ms`],
  ];
}
