// One card a vehicle: its state at a glance; a tap shows it, its box adds it to those that commands go to.

import { byId, fill, make, setAttribute, setSymbol, setText, show, symbol } from "./dom.js";
import { vehicleColour } from "./room.js";
import { look, number } from "./words.js";

export class Cards {
  /** @param {import("./fleet.js").Fleet} fleet @param {() => void} onChange */
  constructor(fleet, onChange) {
    this.fleet = fleet;
    this.onChange = onChange;
    /** @type {Map<string, any>} */
    this.cards = new Map();
  }

  show() {
    const names = [...this.fleet.vehicles.keys()];
    show(byId("cards"), names.length > 1);
    show(byId("whom"), names.length > 1);
    fill(byId("cards"), JSON.stringify(names), () => names.map((name) => this.make(name)));
    fill(byId("whom"), JSON.stringify(names), () => this.makeWhom(names));
    names.forEach((name, index) => this.update(this.fleet.vehicle(name), index));
    const whom = [...this.fleet.selected];
    setText(byId("targets"), names.length > 1 ? `to ${whom.join(", ") || "nobody: choose a vehicle"}` : "");
    this.showWhom(whom, names);
  }

  /** @param {string} name */
  make(name) {
    const card = make("div", "card");
    const button = make("button");
    button.type = "button";
    const parts = {
      card, button, name: make("strong", "name", name), word: make("span", "word"), line: make("span", "line"),
      fault: make("span", "why"), box: make("input"),
    };
    button.append(symbol("none"), parts.name, parts.word, parts.line, parts.fault);
    button.addEventListener("click", () => {
      this.fleet.look(name);
      this.fleet.chosen = true;
      this.onChange();
    });
    parts.box.type = "checkbox";
    parts.box.addEventListener("change", () => this.choose(name, parts.box.checked));
    const label = make("label");
    label.append(parts.box, make("span", "", "command"), make("span", "unseen", ` ${name}`));
    card.append(button, label);
    this.cards.set(name, parts);
    return card;
  }

  /** @param {string} name @param {boolean} on */
  choose(name, on) {
    this.fleet.chosen = true;
    if (on) this.fleet.selected.add(name);
    else this.fleet.selected.delete(name);
    if (this.fleet.selected.size === 0) this.fleet.selected.add(this.fleet.focusName); // never nobody: Land must land
    this.onChange();
  }

  /** @param {import("./fleet.js").Vehicle} vehicle @param {number} index */
  update(vehicle, index) {
    const parts = this.cards.get(vehicle.name);
    if (parts === undefined) return;
    const { state } = vehicle;
    const looks = look(vehicle);
    const stale = vehicle.ageS > 1;
    setAttribute(parts.card, "data-tone", stale ? "unknown" : looks.tone);
    parts.card.style.setProperty("--own", vehicleColour(index));
    setSymbol(parts.button, looks.symbol);
    setText(parts.word, looks.word);
    const battery = state?.battery === null || state?.battery === undefined ? null : state.battery * 100;
    setText(parts.line, state === null ? "" : `${number(state.position_w_m?.[2], 2, " m")} · ${number(battery, 0, " %")}`);
    const faults = vehicle.faults.size > 0 ? `fault: ${[...vehicle.faults.keys()].join(", ")}` : "";
    setText(parts.fault, stale && state !== null ? `no state for ${Math.floor(vehicle.ageS)} s` : faults);
    setAttribute(parts.button, "aria-pressed", String(vehicle.name === this.fleet.focusName));
    parts.box.checked = this.fleet.selected.has(vehicle.name);
  }

  /** @param {string[]} names */
  makeWhom(names) {
    const one = make("button", "", "");
    const all = make("button", "", `All ${names.length}`);
    one.id = "whom-one";
    all.id = "whom-all";
    for (const button of [one, all]) button.type = "button";
    one.addEventListener("click", () => {
      this.fleet.look(this.fleet.focusName);
      this.onChange();
    });
    all.addEventListener("click", () => {
      this.fleet.chosen = true;
      this.fleet.selected = new Set(names);
      this.onChange();
    });
    return [make("span", "", "To"), one, all];
  }

  /** @param {string[]} whom @param {string[]} names */
  showWhom(whom, names) {
    if (names.length < 2) return;
    const all = whom.length === names.length;
    setText(byId("whom-one"), all ? `Only ${this.fleet.focusName}` : whom.join(", ") || "nobody");
    setAttribute(byId("whom-one"), "aria-pressed", String(!all));
    setAttribute(byId("whom-all"), "aria-pressed", String(all));
  }
}
