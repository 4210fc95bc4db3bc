// Everything that the page knows of the vehicles. Messages go in; nothing is drawn here.

import { isInAir } from "./words.js";

/** Length of trails and curves, s. */
export const SPAN_S = 60;
/** Vehicles that are found within this time may come first; one that comes later never moves what buttons command. */
const FIRST_MS = 2000;
const MOST_EVENTS = 200;
const MOST_SAMPLES = 1000;

const nowS = () => performance.now() / 1000;

export class Vehicle {
  /** @param {string} name */
  constructor(name) {
    this.name = name;
    /** @type {any} */ this.about = null;
    /** @type {any} */ this.presence = null;
    /** @type {any} */ this.state = null;
    /** @type {any} */ this.armsB = null;
    /** Page's time at which the newest state was true, s. */
    this.stateS = -Infinity;
    /** @type {{t: number, p: number[]}[]} */ this.trail = [];
    /** @type {any[]} */ this.samples = [];
    /** @type {any[]} */ this.events = [];
    /** @type {Map<string, any>} Active faults by name: text, reaction, sinceS (service's clock). */
    this.faults = new Map();
    /** @type {Map<string, any>} Newest event of each fault, active or not. */
    this.told = new Map();
    /** @type {any} Checks of the last preflight: rows, running, text. */
    this.preflight = null;
    /** @type {string[]} */ this.records = [];
    /** @type {number[] | null} Place chosen in the plan, x and y in W, m. */
    this.target = null;
  }

  /** Age of the newest state, s; infinite before the first. */
  get ageS() {
    return nowS() - this.stateS;
  }

  /** Time by the service's clock, s. */
  get timeS() {
    return (this.state?.time_s ?? 0) + this.ageS;
  }

  /** @param {any} message */
  takeState(message) {
    const state = message.state;
    this.armsB = message.arms_b_m ?? null;
    this.state = state;
    this.stateS = nowS() - Math.max(0, message.age_s ?? 0);
    this.matchFaults(state);
    if (state.record && this.records[0] !== state.record) this.records.unshift(state.record);
    const t = state.time_s;
    if (this.samples.length > 0 && t < this.samples[this.samples.length - 1].t) this.samples = [];
    if (this.trail.length > 0 && t < this.trail[this.trail.length - 1].t) this.trail = [];
    if (state.position_w_m) this.trail.push({ t, p: state.position_w_m });
    this.samples.push({
      t,
      error: state.error_m ?? null,
      height: state.position_w_m?.[2] ?? null,
      goal: state.reference_w_m?.[2] ?? null,
      share: state.sent_share ?? null,
      age: state.age_s ?? null,
    });
    const old = t - SPAN_S;
    while (this.trail.length > 0 && (this.trail[0].t < old || this.trail.length > MOST_SAMPLES)) this.trail.shift();
    while (this.samples.length > 0 && (this.samples[0].t < old || this.samples.length > MOST_SAMPLES)) {
      this.samples.shift();
    }
  }

  /**
   * Make the active faults those of a state. An event that is newer than the state is not undone by it.
   * @param {any} state
   */
  matchFaults(state) {
    const names = new Set(state.faults ?? []);
    for (const [name, fault] of this.faults) {
      if (!names.has(name) && fault.sinceS <= state.time_s) this.faults.delete(name);
    }
    for (const name of names) {
      const known = this.told.get(name);
      if (this.faults.has(name) || (known && known.endedS > state.time_s)) continue;
      this.faults.set(name, { text: known?.text ?? "", reaction: known?.reaction ?? "", sinceS: state.time_s });
    }
  }

  /**
   * @param {any} event
   * @param {boolean} old it is told again to a new page
   */
  takeEvent(event, old) {
    this.events.unshift(event);
    this.events.length = Math.min(this.events.length, MOST_EVENTS);
    if (event.kind === "fault") {
      this.told.set(event.name, { text: event.text, reaction: event.reaction, endedS: -Infinity });
      const active = this.faults.get(event.name);
      if (active) Object.assign(active, { text: event.text, reaction: event.reaction });
      if (!old && !active) {
        this.faults.set(event.name, { text: event.text, reaction: event.reaction, sinceS: event.time_s });
      }
    } else if (event.kind === "fault ends") {
      const known = this.told.get(event.name);
      if (known) known.endedS = event.time_s;
      if (!old) this.faults.delete(event.name);
    }
  }

  /** Forget what a connection that broke may have missed; the server tells the events again. */
  forget() {
    this.events = [];
    this.preflight = this.preflight?.running ? null : this.preflight;
  }

  get inAir() {
    return this.state !== null && isInAir(this.state);
  }
}

export class Fleet {
  constructor() {
    /** @type {Map<string, Vehicle>} */ this.vehicles = new Map();
    this.focusName = "";
    /** The vehicle in view, or those that commands go to, were chosen, and not only found first. */
    this.chosen = false;
    /** Time of the first greeting, ms. */
    this.firstMs = Infinity;
    /** @type {Set<string>} Names of the vehicles that commands go to. */
    this.selected = new Set();
    this.canCommand = false;
    this.password = false;
    this.linked = true;
    this.unlinkedWhy = "";
    this.version = "";
    this.greeted = false;
  }

  /** @type {Vehicle | null} */
  get focus() {
    return this.vehicles.get(this.focusName) ?? null;
  }

  /**
   * Show one vehicle; commands go to it alone.
   * @param {string} name
   */
  look(name) {
    this.focusName = name;
    this.selected = new Set([name]);
  }

  /**
   * @param {string} name
   * @returns {Vehicle}
   */
  vehicle(name) {
    let found = this.vehicles.get(name);
    if (found === undefined) {
      found = new Vehicle(name);
      this.vehicles.set(name, found);
      if (this.focusName === "") this.look(name);
    }
    return found;
  }

  /** @param {any} message of any type but reply, error and confirm */
  take(message) {
    if (message.type === "hello") this.greet(message);
    else if (message.type === "broker") this.takeBroker(message);
    else if (message.type === "about") this.vehicle(message.vehicle).about = message.about;
    else if (message.type === "presence") this.vehicle(message.vehicle).presence = message.presence;
    else if (message.type === "state") this.vehicle(message.vehicle).takeState(message);
    else if (message.type === "event") this.vehicle(message.vehicle).takeEvent(message.event, message.old === true);
  }

  /** @param {any} message */
  takeBroker(message) {
    this.linked = message.linked;
    this.unlinkedWhy = message.why ?? "";
  }

  /** Forget what a new connection tells again. */
  forget() {
    for (const vehicle of this.vehicles.values()) vehicle.forget();
  }

  /** @param {any} hello */
  greet(hello) {
    if (!this.greeted) this.firstMs = performance.now();
    this.greeted = true;
    this.canCommand = hello.can_command;
    this.password = hello.password;
    this.version = hello.version;
    const before = this.vehicles;
    const begins = !this.chosen && performance.now() - this.firstMs < FIRST_MS;
    // a server that has just begun has not found all yet: the buttons must not turn to another vehicle meanwhile
    const kept = begins ? [] : [this.focusName, ...this.selected].filter((name) => before.has(name));
    const names = new Set([...hello.vehicles, ...kept]);
    this.vehicles = new Map([...names].map((name) => [name, before.get(name) ?? new Vehicle(name)]));
    if (begins || !this.vehicles.has(this.focusName)) this.look(hello.vehicles[0] ?? "");
    for (const name of this.selected) if (!this.vehicles.has(name)) this.selected.delete(name);
    if (this.selected.size === 0 && this.focusName !== "") this.selected.add(this.focusName);
  }
}
