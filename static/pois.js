/* The page Places: everything that the scene does by dragging, as tables and forms. */

import { connectionsTable } from "./connections.js";
import { $, setText } from "./dom.js";
import { editorPage } from "./draft.js";
import { isTyping } from "./keys.js";
import { placesTable } from "./places.js";
import { othersAt } from "./presence.js";
import { roadsTable } from "./roads.js";
import { tabs } from "./tabs.js";

let at = new Map(); // who else is at which thing

const { me, graph, begin } = await editorPage({ show: (data) => { showVersion(data); showTables(); }, heard });
const tables = [placesTable, connectionsTable, roadsTable].map((make) => make(graph, me, (kind, id) => at.get(`${kind}/${id}`) ?? ""));
const chooseTab = tabs(document.querySelector("[role=tablist]"));
const chooseByAddress = () => chooseTab(`tab-${location.hash.slice(1)}`);
addEventListener("hashchange", chooseByAddress);
chooseByAddress();

function showTables() {
  for (const { show } of tables) show(graph.data);
  setText($("count-places"), String(graph.data.pois.length));
  setText($("count-connections"), String(graph.data.edges.length));
  setText($("count-roads"), String(graph.data.roads.length));
}

function showVersion({ version, published_version, can_undo, can_redo }) {
  const clean = version === published_version;
  setText($("version"), clean
    ? `Version ${version} is published: this is what devices are given.`
    : `This is the draft, version ${version}; devices are given version ${published_version} until you publish.`);
  $("publish").disabled = clean;
  $("undo").disabled = !can_undo;
  $("redo").disabled = !can_redo;
}

function heard({ people }) {
  const now = othersAt(people);
  if (JSON.stringify([...now]) === JSON.stringify([...at])) return;
  at = now;
  showTables();
}

document.addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]")) return;
  if (event.key === "/" && !isTyping(event.target)) {
    event.preventDefault();
    document.querySelector("[role=tabpanel]:not([hidden]) input[type=search]")?.focus();
  }
  if (event.altKey && event.key.toLowerCase() === "n" && me.mayEdit) {
    event.preventDefault();
    $("add-poi").click();
  }
});

await graph.fetch();
begin();
