// Lists: preflight checks, links and record, events and commands.

import { entryTone, entryWords } from "./commands.js";
import { byId, fill, make, setText, symbol } from "./dom.js";
import { age, clock, number, reactionWords } from "./words.js";

const MOST_ROWS = 120;
const POSE_OLD_S = 0.1;
const PX4_OLD_S = 0.5;

/**
 * Make a row: symbol, name, text.
 * @param {string} tone ok, warn, bad, busy or none @param {string} name @param {string} text @param {string} [more]
 */
function row(tone, name, text, more = "") {
  const node = make("li");
  node.dataset.tone = tone;
  const words = make("div");
  words.append(make("strong", "", name), make("span", "", text === "" ? "" : ` ${text}`));
  if (more !== "") words.append(make("em", "", more));
  node.append(symbol(tone), words);
  return node;
}

/** Show the checks of the last preflight. @param {any} vehicle */
export function showChecks(vehicle) {
  const preflight = vehicle?.preflight ?? null;
  const checks = preflight?.checks ?? [];
  const passed = checks.filter((/** @type {any} */ check) => check.passed).length;
  let sum = "not run yet";
  if (preflight !== null) sum = preflight.running ? "running" : preflight.text;
  if (checks.length > 0) sum = `${passed} of ${checks.length} pass${preflight.running ? ", running" : ""}`;
  setText(byId("checks-sum"), sum);
  fill(byId("checks"), JSON.stringify([checks, preflight?.text, preflight?.running]), () => {
    const sorted = [...checks].sort((one, other) => rank(one) - rank(other));
    const rows = sorted.map((check) => {
      const tone = check.passed ? "ok" : check.must === false ? "warn" : "bad";
      return row(tone, check.name, check.says, check.passed || !check.todo ? "" : `→ ${check.todo}`);
    });
    if (preflight?.running) rows.unshift(row("busy", "running", preflight.text));
    else if (checks.length === 0) rows.push(row("none", "no result", preflight?.text || "press Preflight to run all checks"));
    return rows;
  });
}

/** Put failed checks first, then warnings. @param {any} check */
function rank(check) {
  if (check.passed) return 2;
  return check.must === false ? 1 : 0;
}

/** Show the links. @param {import("./fleet.js").Fleet} fleet @param {number} silentS @param {boolean} open */
export function showLinks(fleet, silentS, open) {
  const vehicle = fleet.focus;
  const state = vehicle?.state ?? null;
  const rows = [["page", open && silentS < 1 ? "ok" : "bad", open ? `heard ${age(silentS)} ago` : "no connection", ""]];
  rows.push(["broker", fleet.linked ? "ok" : "bad", fleet.linked ? "connected" : "not connected", fleet.linked ? "" : fleet.unlinkedWhy]);
  if (vehicle !== null) rows.push(service(vehicle));
  if (state !== null) rows.push(...[...devices(state), record(vehicle)].map((one) => remembered(one, vehicle.ageS)));
  fill(byId("links"), JSON.stringify(rows), () =>
    rows.map(([name, tone, text, more]) => row(tone, name, text, more)),
  );
}

/** @param {any} vehicle */
function service(vehicle) {
  const there = vehicle.presence;
  const fresh = vehicle.ageS < 1;
  const where = there?.host ? `on ${there.host}` : "";
  if (fresh) return ["service", "ok", `${where}${there?.version ? `, version ${there.version}` : ""}`, ""];
  const said = there && !there.online ? "does not run" : "says nothing";
  return ["service", "bad", `${said}; last state ${age(vehicle.ageS)} ago`, where];
}

/** Return a row as what was known when the last state came. @param {string[]} row @param {number} ageS of the state */
function remembered([name, tone, text, more], ageS) {
  return ageS < 1 ? [name, tone, text, more] : [name, "none", `${text}, ${age(ageS)} ago`, more];
}

/** @param {any} state */
function devices(state) {
  const pose = state.age_s ?? null;
  const px4 = state.px4_age_s ?? null;
  const rows = [["motion capture", pose === null || pose > POSE_OLD_S ? "bad" : "ok", pose === null ? "no pose" : `pose ${age(pose)} old`, ""]];
  const mode = state.mode ? `, ${state.mode}` : "";
  const heard = px4 === null ? (state.mode ? "heard" : "not heard") : `heard ${age(px4)} ago`;
  const text = state.text && (state.text_age_s ?? 0) < 60 ? `${clock(state.time_s - (state.text_age_s ?? 0))} ${state.text}` : "";
  rows.push(["PX4", heard === "not heard" || (px4 ?? 0) > PX4_OLD_S ? "bad" : "ok", `${heard}${mode}`, text]);
  const law = state.law_link;
  if (law) {
    const says = law.connected ? `${law.host}, silent ${age(law.silence_s)}, ${law.missing} lost` : law.refused || "none";
    rows.push(["ground law", law.connected && !law.blind && !law.failed ? "ok" : "bad", says, ""]);
  }
  if (state.controller) rows.push(["controller", "ok", state.controller, state.late_s ? `cycle ${number(state.late_s * 1000, 1, " ms")} late` : ""]);
  for (const other of state.others ?? []) {
    const seen = other.position_w_m !== null;
    rows.push([other.body, seen ? "ok" : "bad", seen ? `${number(other.distance_m, 1, " m")} away` : `not seen for ${age(other.age_s)}`, ""]);
  }
  return rows;
}

/** @param {any} vehicle */
function record(vehicle) {
  const name = vehicle.state.record ?? "";
  const before = vehicle.records.filter((/** @type {string} */ one) => one !== name).slice(0, 3);
  const more = before.length > 0 ? `before: ${before.join(", ")}` : "";
  return ["record", name === "" ? "none" : "ok", name === "" ? "no file is being written" : name, more];
}

const EVENT_TONES = { fault: "bad", "fault ends": "ok", phase: "none", command: "busy", reply: "busy", log: "none" };

/** Show events and this page's commands, newest first. @param {any} vehicle @param {any[]} entries */
export function showLog(vehicle, entries) {
  const events = (vehicle?.events ?? []).map((/** @type {any} */ event) => ({
    timeS: event.time_s,
    tone: event.kind === "fault" && event.reaction === "warn" ? "warn" : (EVENT_TONES[event.kind] ?? "none"),
    name: event.kind,
    text: eventWords(event),
  }));
  const commands = entries
    .filter((entry) => entry.vehicle === "" || entry.vehicle === vehicle?.name)
    .map((entry) => ({ timeS: entry.timeS, tone: entryTone(entry), name: "you", text: entryWords(entry, true, false) }));
  const all = [...events, ...commands].sort((one, other) => other.timeS - one.timeS).slice(0, MOST_ROWS);
  fill(byId("log"), JSON.stringify(all), () =>
    all.map((one) => {
      const node = row(one.tone, one.name, one.text);
      node.querySelector("div").prepend(make("time", "", `${clock(one.timeS)} `));
      return node;
    }),
  );
}

/** @param {any} event */
function eventWords(event) {
  if (event.kind === "fault") return `${event.name}: ${event.text} → ${reactionWords(event.reaction)}`;
  if (event.kind === "fault ends") return event.name;
  if (event.kind === "phase") return event.text;
  return event.name && !event.text.startsWith(event.name) ? `${event.name}: ${event.text}` : event.text;
}
