// Buttons and fields: each sends its command and shows beside it what became of it.

import { entryTone, entryWords } from "./commands.js";
import { byId, fill, fillSelect, make, setAttribute, setText, show, symbol } from "./dom.js";
import { isInAir } from "./words.js";

/** Verbs that go to every chosen vehicle; the others have a place or a path, and go to the one in view. */
const TO_ALL = new Set(["preflight", "arm", "takeoff", "hold", "land", "abort", "controller", "arms", "disarm", "resume"]);
const LAST_SHOWN_MS = 8000;
const CURVES = ["ellipse", "figure8"];

/** @param {string} id */
const numberIn = (id) => (byId(id).value.trim() === "" ? NaN : Number(byId(id).value));

export class Controls {
  /**
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./commands.js").Commands} commands
   * @param {() => boolean} allowed
   */
  constructor(fleet, commands, allowed) {
    this.fleet = fleet;
    this.commands = commands;
    this.allowed = allowed;
    this.heightFor = "";
    for (const form of ["goto", "takeoff", "track", "controller", "play"]) {
      byId(form).addEventListener("submit", (/** @type {Event} */ event) => {
        event.preventDefault();
        this.press(/** @type {any} */ (byId(form).querySelector("[data-command]")));
      });
    }
    for (const button of document.querySelectorAll("button[data-command]:not([type=submit])")) {
      button.addEventListener("click", () => this.press(/** @type {HTMLElement} */ (button)));
    }
    byId("goto-clear").addEventListener("click", () => this.choose(null));
    for (const id of ["goto-x", "goto-y", "goto-z"]) byId(id).addEventListener("input", () => this.typed());
  }

  /** @param {HTMLElement} button */
  press(button) {
    const verb = button.dataset.command ?? "";
    if (!this.allowed()) return;
    if (this.fleet.focusName === "") {
      this.commands.note({ text: "the page knows no vehicle yet" });
      return;
    }
    const fields = this.fields(verb, button.dataset.do ?? "");
    const names = TO_ALL.has(verb) ? [...this.fleet.selected] : [this.fleet.focusName];
    for (const name of names) this.commands.send(name, verb, fields);
  }

  /** Return the fields of a command. @param {string} verb @param {string} what */
  fields(verb, what) {
    if (verb === "goto") return { x_m: numberIn("goto-x"), y_m: numberIn("goto-y"), z_m: numberIn("goto-z") };
    if (verb === "takeoff") {
      const height = numberIn("takeoff-height");
      return Number.isNaN(height) ? {} : { height_m: height };
    }
    if (verb === "track") return trackFields();
    if (verb === "controller") return { name: byId("controller-name").value };
    if (verb === "arms") return what === "play" ? { do: what, motion: byId("play-motion").value } : { do: what };
    return {};
  }

  /** Choose a place for "go to"; its height is the one it flies at. @param {number[] | null} place */
  choose(place) {
    const vehicle = this.fleet.focus;
    if (vehicle === null) return;
    vehicle.target = place;
    byId("goto-x").value = place?.[0] ?? "";
    byId("goto-y").value = place?.[1] ?? "";
    if (place !== null && byId("goto-z").value === "") byId("goto-z").value = this.usualHeight(vehicle).toFixed(1);
    this.typed();
  }

  /** @param {import("./fleet.js").Vehicle} vehicle */
  usualHeight(vehicle) {
    const flies = vehicle.state !== null && isInAir(vehicle.state);
    return (flies ? vehicle.state.reference_w_m?.[2] : null) ?? vehicle.about?.takeoff_height_m ?? 1.2;
  }

  /** Show in plan and room what the fields say. */
  typed() {
    const vehicle = this.fleet.focus;
    const [x, y, z] = [numberIn("goto-x"), numberIn("goto-y"), numberIn("goto-z")];
    if (vehicle !== null) {
      const known = !Number.isNaN(x) && !Number.isNaN(y);
      vehicle.target = known ? [x, y, ...(Number.isNaN(z) ? [] : [z])] : null;
      show(byId("goto-clear"), known);
    }
  }

  show() {
    const vehicle = this.fleet.focus;
    this.showChoices(vehicle);
    for (const output of document.querySelectorAll("output[data-answer]")) this.showAnswer(/** @type {any} */ (output));
    this.showLast();
  }

  /** @param {import("./fleet.js").Vehicle | null} vehicle */
  showChoices(vehicle) {
    const about = vehicle?.about ?? null;
    const laws = about?.controllers ?? [];
    const flown = vehicle?.state?.controller ?? "";
    const motions = about?.motions ?? [];
    fillSelect(byId("track-curve"), about?.curves?.length ? about.curves : CURVES);
    fillSelect(byId("controller-name"), laws.length ? laws : flown ? [flown] : []);
    fillSelect(byId("play-motion"), motions);
    fillSelect(byId("track-arms"), motions, "none");
    show(byId("track-arms-label"), motions.length > 0);
    show(byId("arms"), Boolean(about?.arms) || Boolean(vehicle?.state?.arms));
    setText(byId("arms-phase"), vehicle?.state?.arms ?? "");
    if (vehicle !== null && this.heightFor !== vehicle.name && about !== null) {
      this.heightFor = vehicle.name;
      byId("takeoff-height").value = about.takeoff_height_m;
      byId("controller-name").value = flown;
      this.showTarget(vehicle);
    }
  }

  /** Put the place that was chosen for a vehicle into the fields again. @param {import("./fleet.js").Vehicle} vehicle */
  showTarget(vehicle) {
    ["goto-x", "goto-y", "goto-z"].forEach((id, i) => {
      byId(id).value = vehicle.target?.[i] ?? "";
    });
    show(byId("goto-clear"), vehicle.target !== null);
  }

  /** @param {any} output */
  showAnswer(output) {
    const entries = this.commands.newest(output.dataset.answer).filter((entry) => this.fleet.vehicles.has(entry.vehicle));
    const rows = this.grouped(entries);
    fill(output, JSON.stringify(rows), () =>
      rows.map(([tone, text]) => {
        const span = make("span", "answer");
        span.dataset.tone = tone;
        span.append(symbol(tone), make("span", "", text));
        return span;
      }),
    );
  }

  /**
   * Return tone and words of answers; vehicles with the same answer share a row.
   * @param {import("./commands.js").Entry[]} entries
   */
  grouped(entries) {
    const size = this.fleet.vehicles.size;
    /** @type {Map<string, {tone: string, names: string[]}>} */
    const rows = new Map();
    for (const entry of entries) {
      const words = entryWords(entry, false, false);
      const found = rows.get(words);
      if (found) found.names.push(entry.vehicle);
      else rows.set(words, { tone: entryTone(entry), names: [entry.vehicle] });
    }
    return [...rows].map(([words, { tone, names }]) => {
      const who = names.length === size ? "all " : `${names.sort().join(", ")} `;
      return [tone, `${size > 1 ? who : ""}${words}`];
    });
  }

  /** Show what became of the newest command, large, for a while. */
  showLast() {
    const last = byId("last");
    const entry = this.commands.entries[0];
    const recent = entry && performance.now() - entry.changedMs < LAST_SHOWN_MS;
    show(last, Boolean(recent));
    if (!recent) return;
    setAttribute(last, "data-tone", entryTone(entry));
    const words = entryWords(entry, true, this.fleet.vehicles.size > 1);
    fill(last, `${entryTone(entry)} ${words}`, () => [symbol(entryTone(entry)), make("span", "", words)]);
  }
}

function trackFields() {
  /** @type {any} */
  const fields = { curve: byId("track-curve").value };
  const [laps, period, size] = [numberIn("track-laps"), numberIn("track-period"), numberIn("track-size")];
  if (!Number.isNaN(laps)) fields.laps = Math.round(laps);
  if (!Number.isNaN(period)) fields.period_s = period;
  if (!Number.isNaN(size)) fields.size = size;
  if (byId("track-arms").value) fields.arms = byId("track-arms").value;
  return fields;
}
