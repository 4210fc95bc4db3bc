// The room: fence, and which colour a vehicle has in both views.

import { colour } from "./theme.js";

const FENCE = { x_m: [-4.5, 4.5], y_m: [-4.5, 4.5], top_m: 3.5 };

/** Return the fence of the vehicle in view, or of any other. @param {import("./fleet.js").Fleet} fleet */
export function fenceOf(fleet) {
  const abouts = [fleet.focus, ...fleet.vehicles.values()].map((vehicle) => vehicle?.about?.fence);
  return abouts.find((fence) => fence) ?? FENCE;
}

/** Return the colour of the vehicle with an index; its name always stands beside it. @param {number} index */
export function vehicleColour(index) {
  return colour(`vehicle-${(index % 4) + 1}`);
}

/**
 * Return other bodies that no vehicle of the page tells of itself: name, position and age.
 * @param {import("./fleet.js").Fleet} fleet
 */
export function strangers(fleet) {
  const own = new Set([...fleet.vehicles.values()].flatMap((one) => [one.name, one.about?.body, one.presence?.body]));
  const found = new Map();
  for (const vehicle of fleet.vehicles.values()) {
    for (const other of vehicle.state?.others ?? []) {
      if (!own.has(other.body) && other.position_w_m) found.set(other.body, other);
    }
  }
  return [...found.values()];
}

/**
 * Return a trail as a line: the pen is lifted where no position was known for a while.
 * @param {{t: number, p: number[]}[]} trail
 * @param {(p: number[]) => number[] | null} project
 */
export function trailLine(trail, project) {
  const points = [];
  for (let i = 0; i < trail.length; i += 1) {
    if (i > 0 && trail[i].t - trail[i - 1].t > 1) points.push(null);
    points.push(project(trail[i].p));
  }
  return points;
}
