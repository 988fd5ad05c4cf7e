/* What the pages of the map editor share: the draft followed live, undo and redo, who else is here, the tour of a first visit. */

import { $, icon } from "./dom.js";
import { Graph } from "./graph.js";
import { undoKeys } from "./keys.js";
import { follow } from "./live.js";
import { bePresent, peopleLine } from "./presence.js";
import { ready, start } from "./shell.js";
import { tourOnFirstVisit } from "./tour.js";

/** Begin a page of the editor. `show(data)` hears each state of the draft, `heard(live)` each message of the live stream, `asked()` that
 *  publishing was asked for, which checks the draft. Returns the graph, not fetched yet, and who is signed in; call `begin()` when the page is whole. */
export async function editorPage({ show, heard = () => {}, asked = () => {} }) {
  const me = await start();
  const graph = new Graph(show);
  for (const node of document.querySelectorAll(".editing, #undo, #redo, #publish")) node.hidden = !me.mayEdit;
  for (const [id, act] of [["undo", () => graph.undo()], ["redo", () => graph.redo()]]) {
    $(id)?.prepend(icon(id));
    $(id)?.addEventListener("click", act);
  }
  $("publish")?.addEventListener("click", () => graph.publish().then(asked));
  if (me.mayEdit) undoKeys(graph);
  const showPeople = peopleLine(graph);
  return {
    me, graph,
    begin() {
      bePresent();
      follow((data, elapsed_s, linked) => {
        graph.heard(data);
        showPeople(data.people);
        if ($("undo")) $("undo").disabled = !data.can_undo || !linked;
        if ($("redo")) $("redo").disabled = !data.can_redo || !linked;
        heard(data, elapsed_s, linked);
      }, () => "devices=none");
      ready();
      tourOnFirstVisit(me);
    },
  };
}
