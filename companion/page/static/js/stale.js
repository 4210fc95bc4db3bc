// Says, and greys out, what is no longer true.

import { byId, setText, show } from "./dom.js";
import { clock } from "./words.js";

/** The promise is one second; a tick of the page and its drawing come on top. */
const STALE_S = 0.75;

/**
 * Show since when the page is stale, if it is.
 * @param {import("./fleet.js").Fleet} fleet @param {import("./link.js").Link} link @param {number} silentS
 */
export function showStale(fleet, link, silentS) {
  const [why, ageS] = reason(fleet, link, silentS);
  document.body.classList.toggle("stale", why !== "");
  show(byId("stale"), why !== "");
  if (why === "") return;
  const known = Number.isFinite(ageS);
  setText(byId("stale-why"), known ? `${why} since ${clock(Date.now() / 1000 - ageS)}` : why);
  setText(byId("stale-age"), known ? `(${Math.floor(ageS)} s)` : "");
}

/**
 * Return why the page is stale and for how long, s; an empty reason if it is not.
 * @param {import("./fleet.js").Fleet} fleet @param {import("./link.js").Link} link @param {number} silentS
 * @returns {[string, number]}
 */
function reason(fleet, link, silentS) {
  const vehicle = fleet.focus;
  if (silentS > STALE_S) {
    return [`Stale: ${link.open ? "the page's server says nothing" : "no connection to the page's server"}`, silentS];
  }
  if (!fleet.greeted || vehicle === null || vehicle.ageS <= STALE_S) return ["", 0];
  if (vehicle.state === null) return [`Nothing heard of ${vehicle.name} yet: does its service run?`, Infinity];
  return [`Stale: ${fleet.linked ? `${vehicle.name} says nothing` : "no connection to the broker"}`, vehicle.ageS];
}
