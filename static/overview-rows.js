/* The rows of the page Overview, put together from what the console tells: first all of them, in several messages, then what differs. */

export class OverviewRows {
  constructor() {
    this.rows = new Map();
    this.told = new Set();
    this.isUnfolding = true;
  }

  /** Take in a message. A new stream tells all rows anew: only when it has told them all, those go of which it told nothing. */
  take({ rows, gone, count, anew }) {
    if (anew) this.told.clear();
    for (const [id, changes] of Object.entries(rows)) {
      this.rows.set(id, { ...this.rows.get(id), ...changes });
      this.told.add(id);
    }
    for (const id of gone) {
      this.rows.delete(id);
      this.told.delete(id);
    }
    this.isUnfolding = this.told.size < count;
    if (this.isUnfolding) return;
    for (const id of this.rows.keys()) if (!this.told.has(id)) this.rows.delete(id);
  }
}
