/* The page Import and export. */

import { sendFile, sendFileOnce } from "./api.js";
import { changesList } from "./changes.js";
import { $, el, setText } from "./dom.js";
import { editorPage } from "./draft.js";
import { progressBar } from "./progress.js";
import { toast } from "./toast.js";

const EXPORTS = [
  ["site.zip", "The whole site", "One file: map, road, places and connections as they are published, with checksums. It can be imported here or elsewhere."],
  ["graph.geojson", "Places, connections and roads (GeoJSON)", "The draft. For maps and other programs; metres of this map."],
  ["graph.graphml", "Places and connections (GraphML)", "The draft. For programs that work on graphs."],
  ["cloud.ply", "Point cloud (PLY)", "The points of the building, with colours."],
  ["cloud.pcd", "Point cloud (PCD)", "The same, for programs of the PCL family."],
  ["road.tum", "Road (TUM trajectory)", "The draft’s road."],
];
const previewed = { file: null, token: "" };

const { me, graph, begin } = await editorPage({ show: showDraft });
$("exports").replaceChildren(...(me.mayMap ? EXPORTS.map(exportItem) : [el("li", {}, "Your role may not export: ask an editor or a technician.")]));
$("site-form").closest("section").hidden = !me.mayMap;

/** The whole site is what is published, its parts are what is being edited: said where the two differ. */
function showDraft({ version, published_version }) {
  $("exports-differ").hidden = version === published_version || !me.mayMap;
  setText($("exports-differ"), `The draft is version ${version}; site.zip holds version ${published_version}, which is published. Publish first where the site is to hold what you have edited.`);
}

function exportItem([file, title, words]) {
  return el("li", {}, el("a", { href: `/api/export/${file}`, download: file, class: "button slim" }, file), el("span", {}, el("b", {}, title), el("br"), el("span", { class: "quiet small" }, words)));
}

/** A form that sends a file: `take(answer, file)` gets what the console says; errors stand beside the field. `forget()` drops what
 *  was said of the file before. */
function fileForm(name, pathOf, take, forget = () => {}) {
  const [input, problem, send] = [$(`${name}-file`), $(`${name}-problem`), $(`${name}-send`)];
  const bar = progressBar(`How much of the file has gone`);
  $(`${name}-progress`).append(bar.node);
  const say = (sentence) => {
    setText(problem, sentence);
    if (sentence) input.setAttribute("aria-invalid", "true");
    else input.removeAttribute("aria-invalid");
  };
  input.addEventListener("change", () => { forget(); say(""); });
  $(`${name}-form`).addEventListener("submit", async (event) => {
    event.preventDefault();
    forget();
    const [file] = input.files;
    say(file ? "" : "Choose a file first.");
    if (!file) return input.focus();
    send.disabled = true;
    try {
      const answer = await sendFileOnce(pathOf(file), file, (share) => bar.show(share === 1 ? null : share, share === 1 ? "It has arrived; the console looks at it." : `${file.name} is being sent.`));
      take(answer, file);
    } catch (error) {
      say(error.status === 404 ? "This console cannot import yet." : error.message);
      input.focus();
    } finally {
      send.disabled = false;
      bar.hide();
    }
    return undefined;
  });
}

const graphPath = (file, token) => `/api/import/graph?${new URLSearchParams({ name: file.name.slice(0, 120), ...(token ? { confirm: token } : {}) })}`;

fileForm("graph", (file) => graphPath(file), ({ token, changes, unused, whole, notes }, file) => {
  Object.assign(previewed, { file, token });
  const apply = el("button", { type: "button", class: "primary", disabled: changes.length === 0, onclick: () => confirm(apply) }, "Import it");
  const title = el("h3", { id: "preview-title", tabindex: "-1" }, `What ${file.name} would change`);
  $("preview").replaceChildren(title, ...warnings({ whole, notes, changes }), changesList(changes, (id) => graph.nameOf(id), "Nothing: the draft is like this already."),
    ...(unused.length ? [el("div", { class: "note warn" }, el("p", {}, el("b", {}, `${unused.length} things cannot be used and are left out:`)), el("ul", { class: "changes" }, ...unused.map((sentence) => el("li", {}, sentence))))] : []),
    el("p", { class: "problem", id: "preview-problem", role: "alert" }),
    el("div", { class: "row" }, apply, el("button", { type: "button", onclick: dropPreview }, "Leave it")));
  $("preview").hidden = false;
  title.focus();
}, hidePreview);

/** What somebody should have read before they take a file: it stands above the list, which may be long. */
function warnings({ whole, notes, changes }) {
  const removed = changes.filter(({ change }) => change === "removed").length;
  const replaced = `This file is a whole graph and takes the draft’s place: whatever is not in it is deleted (${removed === 1 ? "one thing" : `${removed} things`} here).`;
  return [...(whole && removed ? [replaced] : []), ...notes].map((sentence) => el("p", { class: "note warn" }, sentence));
}

function hidePreview() {
  $("preview").hidden = true;
}

function dropPreview() {
  hidePreview();
  $("graph-file").focus();
}

async function confirm(button) {
  button.disabled = true;
  try {
    await sendFile(graphPath(previewed.file, previewed.token), previewed.file, () => {});
    await graph.fetch();
    dropPreview();
    $("graph-form").reset();
    toast(`${previewed.file.name} is imported into the draft.`, { action: "Undo", onAction: () => graph.undo() });
  } catch (error) {
    setText($("preview-problem"), error.message);
    button.disabled = false;
  }
}

fileForm("site", () => "/api/import/site", ({ name, serve }) => {
  $("site-done").replaceChildren(`${name} is here as a site of its own. Open it with `, el("code", {}, serve));
  $("site-done").hidden = false;
  $("site-form").reset();
});

await graph.fetch();
begin();
