/* Where a place is, without pointing at it: so many metres along the road, or coordinates. */

import { get } from "./api.js";
import { decimals } from "./dom.js";
import { inListOrder, roadName } from "./graph.js";

const WAYS = { between: "From a place towards another one", road: "From the beginning of a road", xy: "By coordinates" };

export const placeOptions = (pois) => [["", "Choose…"], ...inListOrder(pois).map(({ id, name }) => [id, name])];

/** The fields of a form for a position; `way` is what is offered first. */
export function positionFields(graph, way, poi) {
  const onRoad = graph.data.pois.filter(({ on_road, id }) => on_road && id !== poi?.id);
  const ways = Object.entries(WAYS).filter(([key]) => key === "xy" || graph.data.roads.length).filter(([key]) => key !== "between" || onRoad.length > 1);
  const when = (...which) => (values) => which.includes(values.way);
  const places = placeOptions(onRoad);
  const roads = graph.data.roads.map((road) => [road.id, `${roadName(road.id)}, ${road.length_m.toFixed(1)} m`]);
  return [
    { name: "way", label: "Position", type: "select", options: ways, value: ways.some(([key]) => key === way) ? way : ways[0][0] },
    { name: "distance_m", label: "Metres", type: "number", required: true, min: 0, value: 0, span: 2, shown: when("between", "road") },
    { name: "from_id", label: "From", type: "select", required: true, span: 2, options: places, shown: when("between") },
    { name: "towards_id", label: "Towards", type: "select", required: true, span: 2, options: places, shown: when("between") },
    { name: "road_id", label: "Road", type: "select", required: true, span: 2, options: roads, shown: when("road") },
    { name: "x_m", label: "x (metres)", type: "number", required: true, value: poi && decimals(poi.x_m, 3), span: 3, shown: when("xy") },
    { name: "y_m", label: "y (metres)", type: "number", required: true, value: poi && decimals(poi.y_m, 3), span: 3, shown: when("xy") },
    { name: "free", label: "Free position, off the road", type: "check", value: poi ? !poi.on_road : false, shown: when("xy"),
      hint: "A free-standing place is shown, but nobody is led to it." },
  ];
}

/** Return {x_m, y_m, on_road} of what was filled in. */
export async function positionOf(values) {
  if (values.way === "xy") return { x_m: values.x_m, y_m: values.y_m, on_road: !values.free };
  if (values.way === "road") return { ...(await placeOnRoad(values.road_id, values.distance_m)), on_road: true };
  return { ...(await placeTowards(values.from_id, values.towards_id, values.distance_m)), on_road: true };
}

/** The place that lies so many metres from one place towards another one; behind it where negative. */
export function placeTowards(from_id, towards_id, distance_m) {
  return get(`/api/roads/place?${new URLSearchParams({ from_id, towards_id, distance_m })}`);
}

export function placeOnRoad(road_id, distance_m) {
  return get(`/api/roads/${encodeURIComponent(road_id)}/place?${new URLSearchParams({ distance_m })}`);
}
