// Commands of this page: each is numbered, sent, and followed until its end.

import { verbWords } from "./words.js";

const MOST = 100;
/** Without any answer for so long a command is said to be without one. */
const QUIET_MS = 3000;
const OVER = new Set(["done", "refused", "failed", "unknown", "not sent"]);

/**
 * @typedef {object} Entry
 * @property {number} ref
 * @property {string} vehicle
 * @property {string} verb
 * @property {string} status sending, accepted, running, done, refused, failed, unknown or not sent
 * @property {string} text
 * @property {any} data
 * @property {number} timeS Unix
 * @property {number} changedMs
 */

export class Commands {
  /** @param {import("./link.js").Link} link @param {() => void} onChange */
  constructor(link, onChange) {
    this.link = link;
    this.onChange = onChange;
    this.ref = 0;
    /** @type {Entry[]} newest first */
    this.entries = [];
    /** @type {Map<number, (message: any) => void>} */
    this.confirms = new Map();
    setInterval(() => this.watch(), 500);
  }

  /**
   * Send a command to one vehicle.
   * @param {string} vehicle
   * @param {string} verb
   * @param {object} [fields]
   * @returns {Entry}
   */
  send(vehicle, verb, fields = {}) {
    this.ref += 1;
    const sent = this.link.send({ type: "command", ref: this.ref, vehicle, verb, ...fields });
    const status = sent ? "sending" : "not sent";
    const text = sent ? "" : "no connection to the page's server";
    const timeS = Date.now() / 1000;
    const entry = { ref: this.ref, vehicle, verb, status, text, data: {}, timeS, changedMs: performance.now() };
    this.entries.unshift(entry);
    this.entries.length = Math.min(this.entries.length, MOST);
    this.onChange();
    return entry;
  }

  /**
   * Ask for the number that a kill must carry; it is no command yet.
   * @param {string} vehicle
   * @param {(message: any) => void} onConfirm
   */
  askKill(vehicle, onConfirm) {
    this.ref += 1;
    this.confirms.set(this.ref, onConfirm);
    return this.link.send({ type: "command", ref: this.ref, vehicle, verb: "kill" });
  }

  /** @param {any} message of type reply, error or confirm */
  take(message) {
    if (message.type === "confirm") {
      this.confirms.get(message.ref)?.(message);
      this.confirms.delete(message.ref);
      return;
    }
    const entry = this.entries.find((one) => one.ref === message.ref && !OVER.has(one.status));
    if (entry === undefined) {
      if (message.type === "error") this.note(message);
      return;
    }
    const status = message.type === "error" ? "refused" : message.answer;
    entry.status = status === "progress" ? "running" : status;
    if (message.text) entry.text = message.text;
    if (message.data) entry.data = message.data;
    entry.changedMs = performance.now();
    this.onChange();
  }

  /**
   * Keep an error that belongs to no command, or to the question before a kill.
   * @param {any} message
   */
  note(message) {
    const verb = this.confirms.delete(message.ref) ? "kill" : "";
    const [timeS, changedMs] = [Date.now() / 1000, performance.now()];
    this.entries.unshift({ ref: 0, vehicle: "", verb, status: "refused", text: message.text, data: {}, timeS, changedMs });
    this.onChange();
  }

  /** Say of what runs that its end is not known: the connection broke, and numbers begin again. */
  lose() {
    this.ref = 0;
    this.confirms.clear();
    for (const entry of this.entries) {
      if (!OVER.has(entry.status)) {
        entry.status = "unknown";
        entry.text = "the connection broke: look at the phase";
        entry.changedMs = performance.now();
      }
      entry.ref = 0;
    }
    this.onChange();
  }

  watch() {
    const oldMs = performance.now() - QUIET_MS;
    for (const entry of this.entries) {
      if (entry.status === "sending" && entry.text === "" && entry.changedMs < oldMs) {
        entry.text = "no answer yet";
        this.onChange();
      }
    }
  }

  /**
   * Return the newest entry of a verb for each vehicle.
   * @param {string} verb
   * @returns {Entry[]}
   */
  newest(verb) {
    const found = new Map();
    for (const entry of this.entries) {
      if (entry.verb === verb && !found.has(entry.vehicle)) found.set(entry.vehicle, entry);
    }
    return [...found.values()];
  }
}

/** @param {Entry} entry */
function isOver(entry) {
  return OVER.has(entry.status);
}

/** @param {Entry} entry */
export function entryTone(entry) {
  if (entry.status === "done") return "ok";
  return isOver(entry) ? "bad" : "busy";
}

/** @param {Entry} entry @param {boolean} verb @param {boolean} vehicle say also which */
export function entryWords(entry, verb, vehicle) {
  const what = [verb ? verbWords(entry.verb) : "", vehicle ? entry.vehicle : ""].filter((word) => word).map((word) => `${word} `).join("");
  return `${what}${entry.status}${entry.text ? `: ${entry.text}` : ""}`.trim();
}
