/* Names of places: two of one name cannot be told apart by whoever hears them. */

import { sure } from "./form.js";

const alike = (one, other) => one.trim().toLowerCase() === other.trim().toLowerCase();

/** Two places of one name are asked about: throws where it was not meant. A place that keeps its name is let be. */
export async function refuseTwin(graph, name, before = null) {
  const twin = graph.data.pois.find((poi) => poi.id !== before?.id && alike(poi.name, name));
  if (!twin || (before && alike(before.name, name))) return;
  const meant = await sure({ title: "Two places of one name?", text: `Another place is called ${twin.name}: a walker could not tell them apart.`, yes: "Save all the same", no: "Change the name" });
  if (!meant) throw new Error(`Another place is called ${twin.name}: give this one another name.`);
}
