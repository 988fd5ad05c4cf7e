/* The draft of the PoI-graph: fetched when its version changes, edited through the API. */

import { get, postOnce } from "./api.js";
import { settle } from "./conflict.js";
import { publish } from "./publish.js";
import { attempt, toast } from "./toast.js";

export class Graph {
  /** `show(graph)` is called with each new state of the draft. */
  constructor(show) {
    this.show = show;
    this.data = null;
    this.fetching = false;
    this.pois = new Map();
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
    this.pois = new Map(data.pois.map((poi) => [poi.id, poi]));
    this.show(data);
  }

  /** Make an edit that was decided on while `base` was the draft. Where somebody else has changed the same thing since,
   *  both versions are shown. Returns false where theirs was kept; throws a sentence where nothing could be done. */
  async edit(edit, base = this.data.version) {
    for (;;) {
      try {
        this.take(await postOnce(`/api/edits?base_version=${base}`, edit));
        return true;
      } catch (error) {
        const conflict = error.details?.conflict;
        if (!conflict) throw error;
        await this.fetch();
        const choice = await settle(error.message, conflict, edit, this);
        if (choice === "theirs") return false;
        if (choice !== "mine") throw new Error("Nothing was saved yet: both versions are still there.");
        base = conflict.version;
      }
    }
  }

  undo() {
    return attempt(async () => this.take(await postOnce("/api/undo")), "Taking it back…");
  }

  redo() {
    return attempt(async () => this.take(await postOnce("/api/redo")), "Making it again…");
  }

  publish() {
    return attempt(async () => {
      const data = await publish();
      if (!data) return;
      this.take(data);
      toast(`Version ${data.published_version} is published: devices take it as soon as nobody is being led.`);
    }, "Publishing…");
  }

  poi(id) {
    return this.pois.get(id);
  }

  /** The name of a place, or its identifier where it is gone. */
  nameOf(id) {
    return this.pois.get(id)?.name ?? id;
  }

  /** "Hall – Bar". */
  edgeName({ a, b }) {
    return `${this.nameOf(a)} – ${this.nameOf(b)}`;
  }

  /** Delete something at once; a toast takes it back. */
  remove(edit, words) {
    return attempt(async () => {
      if (await this.edit(edit)) toast(`${words} deleted.`, { action: "Undo", onAction: () => this.undo() });
    }, "Deleting…");
  }

  deletePoi(poi) {
    const edges = this.data.edges.filter((edge) => edge.a === poi.id || edge.b === poi.id).length;
    const ways = edges === 0 ? "" : edges === 1 ? " and one connection" : ` and ${edges} connections`;
    return this.remove({ edit: "delete_poi", poi_id: poi.id }, `${poi.name}${ways}`);
  }
}

const byText = (a, b) => a.localeCompare(b, undefined, { numeric: true });

/** Places in the order of a list: what people walk to first, then the junctions in between; each by name. */
export function inListOrder(pois) {
  const between = ({ kind }) => Number(kind === "junction");
  return [...pois].sort((a, b) => between(a) - between(b) || byText(a.name, b.name));
}

export const KIND_NAMES = {
  room: "Room", toilet: "Wash room", bar: "Bar", lounge: "Lounge", hall: "Hall", junction: "Junction", lift: "Lift",
  stairs: "Stairs", door: "Door", entrance: "Entrance", exit: "Exit", other: "Other",
};

/** "Road 3" of "r3". */
export function roadName(id) {
  return `Road ${id.replace(/^r/, "")}`;
}
