// Words, symbols and tones for phases, faults and answers. A tone is a colour; symbol and word say the same without it.

/** @type {Record<string, {symbol: string, tone: string, says: string}>} */
const PHASES = {
  waiting: { symbol: "none", tone: "unknown", says: "the service has no vehicle yet" },
  standby: { symbol: "ground", tone: "idle", says: "on the ground, motors off" },
  preflight: { symbol: "busy", tone: "ready", says: "being armed" },
  armed: { symbol: "ready", tone: "ready", says: "motors idle on the ground" },
  takeoff: { symbol: "up", tone: "fly", says: "climbing" },
  hold: { symbol: "hold", tone: "fly", says: "hovering" },
  track: { symbol: "go", tone: "fly", says: "flying a track" },
  stow: { symbol: "down", tone: "land", says: "arms fold before the landing" },
  land: { symbol: "down", tone: "land", says: "coming down" },
  disarmed: { symbol: "ground", tone: "idle", says: "the flight is over, motors off" },
  "handed over": { symbol: "away", tone: "away", says: "PX4 or its pilot has the vehicle" },
  resume: { symbol: "busy", tone: "away", says: "taking the vehicle back" },
  terminated: { symbol: "stop", tone: "alarm", says: "the motors were stopped" },
};

const REACTIONS = {
  warn: "only a warning: the flight goes on",
  disarm: "on the ground: preparation ends, motors off",
  hold: "it brakes and hovers; only you can go on",
  land: "it lands where it is",
  "PX4 lands": "PX4 lands it by itself",
  release: "nothing more is sent: PX4 or its pilot has it",
  terminate: "the motors stop at once",
};

const VERBS = {
  preflight: "preflight", arm: "arm", takeoff: "take off", hold: "hold", goto: "go to", track: "track", arms: "arms",
  controller: "controller", land: "land", abort: "abort", resume: "resume", kill: "kill", disarm: "disarm",
};

const IN_AIR = new Set(["takeoff", "hold", "track", "stow", "land"]);

/** @param {any} state */
export function isInAir(state) {
  return state.in_air === true || IN_AIR.has(state.phase);
}

/** @param {string} phase */
export function phaseLook(phase) {
  return PHASES[phase] ?? { symbol: "none", tone: "unknown", says: "" };
}

/** @param {string} reaction */
export function reactionWords(reaction) {
  return REACTIONS[reaction] ?? reaction;
}

/** @param {string} verb */
export function verbWords(verb) {
  return VERBS[verb] ?? verb;
}

/**
 * Return symbol and tone of a vehicle: the worst of its phase and its faults.
 * @param {any} vehicle
 */
export function look(vehicle) {
  const state = vehicle.state;
  if (state === null) return { symbol: "none", tone: "unknown", word: "no state yet" };
  const phase = phaseLook(state.phase);
  let tone = phase.tone;
  const reactions = [...vehicle.faults.values()].map((fault) => fault.reaction);
  const ended = endedByFault(vehicle);
  if (reactions.some((reaction) => reaction !== "warn") || (ended && state.phase !== "disarmed")) tone = "alarm";
  else if (reactions.length > 0 || ended || state.warnings?.length > 0) tone = "warn";
  return { symbol: phase.symbol, tone, word: state.phase };
}

/**
 * Return true if the flight, or what is left of it, is the reaction to a fault: the service gives a reason.
 * @param {any} vehicle
 */
export function endedByFault(vehicle) {
  const state = vehicle.state;
  return Boolean(state?.reason) && state.phase !== "waiting" && !/^the operator/.test(state.reason);
}

/**
 * Return what the vehicle does, in words.
 * @param {any} state
 */
export function doingWords(state) {
  const verb = state.doing?.verb;
  if (!verb) return (state.phase === "waiting" ? state.reason : "") || phaseLook(state.phase).says;
  const says = phaseLook(state.phase).says;
  return verb === state.phase ? says : `${verbWords(verb)}: ${state.doing.text || says}`;
}

/** @param {number | null | undefined} value @param {number} digits @param {string} unit */
export function number(value, digits, unit) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return `${value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1")}${unit}`;
}

/** @param {number} seconds Unix time */
export function clock(seconds) {
  return new Date(seconds * 1000).toLocaleTimeString("en-GB");
}

/** @param {number | null | undefined} seconds */
export function age(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "never";
  return seconds < 1 ? `${Math.round(seconds * 1000)} ms` : `${seconds.toFixed(1)} s`;
}
