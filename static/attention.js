/* Which walkers need somebody first, and why. */

/** How much a row of the overview needs attention: [rank, why]; the lowest rank is most urgent. `fresh` is how fresh the row is. */
export function attention({ connected, mode, action, quality, reason, leads_somebody: led }, fresh) {
  if (mode === "fault") return [0, "Something on the device does not work"];
  if (led && !connected) return [1, "Not connected, and was being guided"];
  if (led && (fresh === "lost" || fresh === "stale")) return [1, "Nothing heard of late, and was being guided"];
  if (mode === "lost") return [2, "The place in the map is not known"];
  if (led && action === "stop" && mode !== "paused") return [3, reason];
  if (led && quality !== "localized") return [4, "The place in the map is uncertain"];
  if (led && fresh === "delayed") return [5, "What is heard is delayed"];
  if (led) return [6, ""];
  if (!connected || fresh === "lost") return [9, connected ? "Nothing heard" : "Not connected"];
  if (fresh === "stale") return [7, "Nothing heard of late"];
  return [8, ""];
}

/** Compare two walkers as they are listed: by need, then by name. */
export function byNeed(a, b) {
  return a.rank - b.rank || a.name.localeCompare(b.name) || a.id.localeCompare(b.id);
}
