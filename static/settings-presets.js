/* Presets: named sets of values, put into the draft, saved from what runs, exported and imported. */

import { ask, get, patch, post } from "./api.js";
import { badge, el } from "./dom.js";
import { openForm, sure } from "./form.js";
import { differences } from "./setting-words.js";
import { attempt, toast } from "./toast.js";

const API = "/api/settings/presets";
const MAX_FILE_BYTES = 200_000;

export class Presets {
  /** `use(values)` puts values into the draft; `changed()` hears that the list is another one. */
  constructor(root, specs, { use, changed }) {
    Object.assign(this, { root, specs, use, changed, list: [], running: {}, deviceId: null });
    this.rows = el("ul", { class: "lines presets" });
    this.name = el("input", { id: "preset-name", maxlength: 60, autocomplete: "off", required: true });
    const file = el("input", { type: "file", accept: "application/json,.json", id: "preset-file", hidden: true, onchange: () => this.read(file) });
    this.saving = el("form", { class: "row", onsubmit: (event) => { event.preventDefault(); this.save(); } },
      el("label", { for: "preset-name" }, "Save what runs as"), el("span", { class: "grow" }, this.name), el("button", { type: "submit" }, "Save"),
      file, el("button", { type: "button", onclick: () => file.click() }, "Import…"));
    root.append(el("h2", { id: "presets-title" }, "Presets"), this.rows, this.saving);
  }

  async load() {
    this.list = (await get(API)).presets;
    this.draw();
    this.changed();
  }

  show(running, deviceId) {
    this.running = running;
    this.deviceId = deviceId;
    this.draw();
  }

  draw() {
    this.rows.replaceChildren(...this.list.map((preset) => this.row(preset)));
  }

  row(preset) {
    const count = differences(this.specs, this.running, preset.values).length;
    const says = count === 0 ? badge("good", "✓", "runs") : badge("info", "≠", `${count} other value${count === 1 ? "" : "s"}`);
    const about = preset.about || `Saved by ${preset.author}, ${new Date(preset.at_s * 1000).toLocaleDateString()}.`;
    const button = (title, work, more = {}) => el("button", { type: "button", class: "plain slim", "aria-label": `${title}: ${preset.name}`, "data-key": `${title} ${preset.name}`, onclick: work, ...more }, title);
    return el("li", {}, el("div", { class: "grow" }, el("strong", {}, preset.name), " ", says, el("p", { class: "small quiet" }, about)),
      el("div", { class: "row" }, button("Put into the draft", () => this.use(preset.values), { disabled: count === 0 }), button("Export", () => this.download(preset)),
        preset.built_in ? null : button("Rename…", () => this.rename(preset)), preset.built_in ? null : button("Delete…", () => this.remove(preset))));
  }

  async save() {
    if (this.deviceId === null) return toast("No device has called yet: there is nothing that runs.", { kind: "bad" });
    const saved = await attempt(() => post(API, { name: this.name.value, device_id: this.deviceId }));
    if (saved) this.name.value = "";
    return this.load();
  }

  download(preset) {
    const file = { format: "vbr-settings-preset", version: 1, name: preset.name, values: preset.values };
    const link = el("a", { href: URL.createObjectURL(new Blob([`${JSON.stringify(file, null, 1)}\n`], { type: "application/json" })), download: `${preset.name}.json` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  async read(input) {
    const [file] = input.files;
    input.value = "";
    if (!file) return;
    await attempt(async () => {
      if (file.size > MAX_FILE_BYTES) throw new Error("This file is too large for a preset: choose one that was exported here.");
      let content;
      try { content = JSON.parse(await file.text()); } catch { throw new Error(`${file.name} is no JSON: choose a preset that was exported here.`); }
      await post(`${API}/import`, content);
    });
    await this.load();
  }

  async rename(preset) {
    await openForm({
      title: `Rename ${preset.name}`,
      fields: [{ name: "name", label: "Name", type: "text", value: preset.name, required: true, maxlength: 60 }],
      submit: ({ name }) => patch(`${API}/${encodeURIComponent(preset.name)}`, { name }),
    });
    await this.load();
  }

  async remove(preset) {
    if (!(await sure({ title: `Delete ${preset.name}?`, text: "The preset is gone then; devices run on as they do.", yes: "Delete it" }))) return;
    await attempt(() => ask("DELETE", `${API}/${encodeURIComponent(preset.name)}`));
    await this.load();
  }
}
