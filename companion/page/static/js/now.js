// The state in one glance: phase, what runs, the big numbers, and faults with reason and reaction.

import { byId, fill, make, setAttribute, setSymbol, setText, show, symbol } from "./dom.js";
import { doingWords, endedByFault, look, number, reactionWords } from "./words.js";

const LOW_BATTERY = 0.3;

/** Show the state of the vehicle in view, and faults of all. @param {import("./fleet.js").Fleet} fleet */
export function showNow(fleet) {
  const vehicle = fleet.focus;
  const state = vehicle?.state ?? null;
  const looks = vehicle === null ? { symbol: "none", tone: "unknown", word: "no vehicle" } : look(vehicle);
  const now = byId("now");
  setAttribute(now, "data-tone", looks.tone);
  setSymbol(now, looks.symbol);
  setText(byId("phase"), looks.word);
  setText(byId("doing"), state === null ? "waiting for the first state" : doingWords(state));
  showTiles(state);
  showFaults(fleet);
}

/** @param {any} state */
function showTiles(state) {
  const speed = state?.velocity_w_mps ? Math.hypot(...state.velocity_w_mps) : null;
  const error = state?.error_m ?? null;
  const share = state?.sent_share ?? null;
  const still = state?.remaining_s ?? null;
  setText(byId("t-height"), number(state?.position_w_m?.[2], 2, " m"));
  setText(byId("t-error"), number(error === null ? null : error * 100, 1, " cm"));
  setText(byId("t-speed"), number(speed, 2, " m/s"));
  setText(byId("t-updates"), number(share === null ? null : share * 100, 0, " %"));
  setText(byId("t-still"), number(still, 0, " s"));
  showBattery(state?.battery ?? null, state?.battery_v ?? null);
}

/** @param {number | null} charge 0..1 @param {number | null} volts */
function showBattery(charge, volts) {
  const text = charge === null ? number(volts, 1, " V") : `${Math.round(charge * 100)} %`;
  setText(byId("t-battery"), text);
  setAttribute(byId("battery"), "data-low", charge !== null && charge < LOW_BATTERY ? "yes" : "no");
}

/** @param {import("./fleet.js").Fleet} fleet */
function showFaults(fleet) {
  const box = byId("faults");
  const rows = fleet.focus === null ? [] : faultRows(fleet.focus);
  for (const vehicle of fleet.vehicles.values()) if (vehicle !== fleet.focus) rows.push(...alarmsOf(vehicle));
  show(box, rows.length > 0);
  fill(box, JSON.stringify(rows), () => rows.map(faultNode));
}

/** Return what a vehicle that is not in view reacts to. @param {import("./fleet.js").Vehicle} vehicle */
function alarmsOf(vehicle) {
  const alarms = faultRows(vehicle).filter((row) => row.tone === "alarm");
  return alarms.map((row) => ({ ...row, name: `${vehicle.name}: ${row.name}` }));
}

/** @param {import("./fleet.js").Vehicle} vehicle */
function faultRows(vehicle) {
  const rows = [...vehicle.faults].map(([name, fault]) => ({
    name,
    text: fault.text,
    reaction: reactionWords(fault.reaction),
    tone: fault.reaction === "warn" ? "warn" : "alarm",
  }));
  const { state } = vehicle;
  const told = rows.some((row) => state?.reason && row.text === state.reason);
  if (state !== null && endedByFault(vehicle) && !told) {
    const over = state.phase === "disarmed";
    rows.push({ name: over ? "The flight ended:" : "Why:", text: state.reason, reaction: "", tone: over ? "warn" : "alarm" });
  }
  for (const text of state?.warnings ?? []) rows.push({ name: "warning", text, reaction: "", tone: "warn" });
  return rows.sort((one, other) => Number(one.tone === "warn") - Number(other.tone === "warn"));
}

/** @param {{name: string, text: string, reaction: string, tone: string}} row */
function faultNode(row) {
  const node = make("div", "fault");
  node.dataset.tone = row.tone;
  const words = make("div");
  const head = make("p");
  head.append(make("strong", "", row.name));
  if (row.text !== "") head.append(make("span", "", ` ${row.text}`));
  words.append(head);
  if (row.reaction !== "") words.append(make("p", "reaction", `→ ${row.reaction}`));
  node.append(symbol(row.tone === "warn" ? "warn" : "stop"), words);
  return node;
}
