/* Tables of hundreds of rows: searched, sorted, drawn by the hundred; only rows that differ are drawn anew, so that nobody who is
 * reading, typing or has the focus inside loses their place when somebody else edits. */

import { el, setText } from "./dom.js";

const ROWS_AT_ONCE = 100;

export class Table {
  /**
   * `columns`: {key, title, class, text(row): what is searched and sorted by, cell(row): what is drawn (the text where absent),
   * head: the row's header, plain: neither sorted nor searched}. `key(row)` identifies a row, `mark(row)` is all else that it shows.
   */
  constructor({ place, name, label, columns, key, mark = () => "", empty, searchHint }) {
    Object.assign(this, { columns, key, mark });
    this.rows = [];
    this.drawn = new Map();
    this.limit = ROWS_AT_ONCE;
    this.sorted = { key: columns[0].key, down: false };
    this.search = el("input", { type: "search", id: `search-${name}`, autocomplete: "off", placeholder: searchHint });
    this.count = el("p", { class: "small quiet number", role: "status" });
    // The roles stand here for a phone, where the rows are drawn as cards and would be a table no more.
    this.head = el("tr", { role: "row" }, ...columns.map((column) => this.headCell(column)));
    this.body = el("tbody", { id: name, role: "rowgroup" });
    this.more = el("button", { type: "button", hidden: true });
    this.find = [el("label", { for: `search-${name}` }, "Search"), this.search, this.count];
    this.bar = el("div", { class: "search-bar" }, ...this.find, place.querySelector(".tools"));
    this.wrap = el("div", { class: "table-wrap" }, el("table", { class: `keyed table-${name}`, role: "table", "aria-label": label }, el("thead", { role: "rowgroup" }, this.head), this.body));
    this.empty = el("div", { class: "empty", hidden: true }, ...empty);
    place.prepend(this.bar);
    place.append(this.empty, this.wrap, el("div", { class: "row more" }, this.more));
    this.search.addEventListener("input", () => { this.limit = ROWS_AT_ONCE; this.draw(); });
    this.more.addEventListener("click", () => {
      const next = this.body.children.length;
      this.limit += ROWS_AT_ONCE;
      this.draw();
      this.body.children[next]?.querySelector("button, input, a")?.focus();
    });
  }

  headCell({ key, title, class: kind, plain }) {
    if (plain) return el("th", { scope: "col", role: "columnheader", class: kind }, el("span", { class: "visually-hidden" }, title));
    const button = el("button", { type: "button", class: "sort", onclick: () => this.sortBy(key) }, title, el("span", { class: "arrow", "aria-hidden": "true" }));
    return el("th", { scope: "col", role: "columnheader", class: kind, "data-column": key, "aria-sort": key === this.sorted.key ? "ascending" : "none" }, button);
  }

  sortBy(key) {
    this.sorted = { key, down: this.sorted.key === key && !this.sorted.down };
    for (const cell of this.head.querySelectorAll("[data-column]")) {
      const mine = cell.dataset.column === key;
      cell.setAttribute("aria-sort", mine ? (this.sorted.down ? "descending" : "ascending") : "none");
    }
    this.draw();
  }

  show(rows) {
    this.rows = rows;
    this.draw();
  }

  draw() {
    const chosen = this.chosen();
    const seen = chosen.slice(0, this.limit);
    this.empty.hidden = this.rows.length > 0;
    for (const node of [...this.find, this.wrap]) node.hidden = this.rows.length === 0;
    setText(this.count, chosen.length === this.rows.length ? `${this.rows.length} in all` : `${chosen.length} of ${this.rows.length}`);
    const rest = chosen.length - seen.length;
    this.more.hidden = rest === 0;
    setText(this.more, `Show ${Math.min(rest, ROWS_AT_ONCE)} more of ${rest}`);
    this.place(seen);
  }

  chosen() {
    const words = this.search.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const searched = this.columns.filter(({ plain }) => !plain);
    const found = words.length === 0 ? [...this.rows] : this.rows.filter((row) => {
      const text = searched.map((column) => column.text(row)).join(" ").toLowerCase();
      return words.every((word) => text.includes(word));
    });
    const { text } = this.columns.find(({ key }) => key === this.sorted.key);
    const turn = this.sorted.down ? -1 : 1;
    const texts = new Map(found.map((row) => [row, String(text(row))]));
    return found.sort((one, other) => turn * ORDER.compare(texts.get(one), texts.get(other)));
  }

  /** Put the rows in their order: those that are as they were stay the same nodes, and keep the focus. */
  place(rows) {
    const focused = this.body.contains(document.activeElement) ? document.activeElement : null;
    const wanted = new Set(rows.map(this.key));
    for (const [key, { node }] of this.drawn) {
      if (wanted.has(key)) continue;
      node.remove();
      this.drawn.delete(key);
    }
    let next = this.body.firstElementChild;
    for (const row of rows) {
      const node = this.nodeOf(row);
      if (node === next) next = next.nextElementSibling;
      else this.body.insertBefore(node, next);
    }
    if (focused && document.activeElement !== focused) this.refocus(focused);
  }

  nodeOf(row) {
    const key = this.key(row);
    const signature = JSON.stringify([row, this.mark(row)]);
    const known = this.drawn.get(key);
    if (known?.signature === signature) return known.node;
    const node = known?.node ?? el("tr", { role: "row" });
    node.replaceChildren(...this.columns.map((column) => cellOf(column, row)));
    this.drawn.set(key, { node, signature });
    return node;
  }

  refocus(before) {
    const again = before.isConnected ? before : before.dataset.key && this.body.querySelector(`[data-key="${CSS.escape(before.dataset.key)}"]`);
    (again || this.search).focus({ preventScroll: true });
  }
}

const ORDER = new Intl.Collator(undefined, { numeric: true });

function cellOf(column, row) {
  const content = column.cell ? column.cell(row) : String(column.text(row));
  const properties = { class: column.class, role: column.head ? "rowheader" : "cell", scope: column.head && "row" };
  return el(column.head ? "th" : "td", properties, ...(Array.isArray(content) ? content : [content]));
}
