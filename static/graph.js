/* The draft of the PoI-graph: fetched when its version changes, edited through the API. */

import { get, post } from "./api.js";
import { attempt, toast } from "./toast.js";

export class Graph {
  /** `show(graph)` is called with each new state of the draft. */
  constructor(show) {
    this.show = show;
    this.data = null;
    this.fetching = false;
  }

  async fetch() {
    this.take(await get("/api/graph"));
  }

  /** Take in the versions that the live stream tells, and fetch what is new. */
  async heard({ draft_version, published_version }) {
    const known = this.data;
    const same = known && known.version === draft_version && known.published_version === published_version;
    if (same || this.fetching) return;
    this.fetching = true;
    await this.fetch().catch(() => {});
    this.fetching = false;
  }

  take(data) {
    if (this.data && data.version < this.data.version) return;
    this.data = data;
    this.show(data);
  }

  async edit(edit) {
    this.take(await post("/api/edits", edit));
  }

  undo() {
    return attempt(async () => this.take(await post("/api/undo")));
  }

  redo() {
    return attempt(async () => this.take(await post("/api/redo")));
  }

  publish() {
    return attempt(async () => {
      this.take(await post("/api/publish"));
      toast(`Version ${this.data.published_version} is published: devices take it as soon as nobody is being led.`);
    });
  }

  poi(id) {
    return this.data?.pois.find((poi) => poi.id === id);
  }

  /** Delete a place at once; a toast takes it back. */
  deletePoi(poi) {
    const edges = this.data.edges.filter((edge) => edge.a === poi.id || edge.b === poi.id).length;
    return attempt(async () => {
      await this.edit({ edit: "delete_poi", poi_id: poi.id });
      const ways = edges === 0 ? "" : edges === 1 ? " and one way" : ` and ${edges} ways`;
      toast(`${poi.name}${ways} deleted.`, { action: "Undo", onAction: () => this.undo() });
    });
  }
}

/** Places in the order of a list: what people walk to first, then the junctions in between; each by name. */
export function inListOrder(pois) {
  const between = ({ kind }) => Number(kind === "junction");
  return [...pois].sort((a, b) => between(a) - between(b) || a.name.localeCompare(b.name, undefined, { numeric: true }));
}

/** Ctrl+Z and Ctrl+Shift+Z (or Ctrl+Y) outside of text fields. */
export function undoKeys(graph) {
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest("input:not([type=checkbox], [type=range]), textarea, select, dialog");
    if (typing || !(event.ctrlKey || event.metaKey)) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) graph.redo();
    else graph.undo();
  });
}

export const KIND_NAMES = {
  room: "Room", toilet: "Wash room", bar: "Bar", lounge: "Lounge", hall: "Hall", junction: "Junction", lift: "Lift",
  stairs: "Stairs", door: "Door", entrance: "Entrance", exit: "Exit", other: "Other",
};
