// Kill: slide to the end and hold there for 2 s. Nothing shorter stops a motor: no tap, no double tap, no Enter, no Space.

import { byId, setAttribute, setText } from "./dom.js";

const HOLD_MS = 2000;
const END = 0.98;
/** A pointer that lands farther from the thumb than this does not take it, heights of the slider. */
const REACH = 0.6;
/** Shift and the right arrow, held: time from one end to the other, ms. */
const KEY_TRAVEL_MS = 800;
const TICK_MS = 40;

export class Kill {
  /**
   * @param {() => string} vehicle name of the vehicle in view
   * @param {import("./commands.js").Commands} commands
   * @param {() => boolean} allowed says why not, if not
   * @param {() => boolean} several there is more than one vehicle, so its name is said
   */
  constructor(vehicle, commands, allowed, several) {
    this.vehicle = vehicle;
    this.several = several;
    this.commands = commands;
    this.allowed = allowed;
    this.slider = byId("kill");
    this.at = 0;
    /** @type {number | null} pointer that holds the thumb; -1 for the keyboard */
    this.holder = null;
    this.heldMs = NaN;
    this.nonce = "";
    /** Time from which the server takes the nonce, ms. */
    this.fromMs = NaN;
    this.name = "";
    this.listen();
    setInterval(() => this.tick(), TICK_MS);
    this.show();
  }

  listen() {
    this.slider.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      const { thumb, height } = this.box();
      const near = Math.abs(event.clientX - thumb) < REACH * height;
      if (this.holder !== null || !near || !event.isPrimary || !this.allowed()) return;
      this.holder = event.pointerId;
      this.grabX = event.clientX;
      this.slider.setPointerCapture(event.pointerId);
    });
    this.slider.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
      if (event.pointerId === this.holder) this.move((event.clientX - this.grabX) / this.box().travel);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      this.slider.addEventListener(end, (/** @type {PointerEvent} */ event) => {
        if (event.pointerId === this.holder) this.release();
      });
    }
    this.slider.addEventListener("contextmenu", (/** @type {Event} */ event) => event.preventDefault());
    this.slider.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.key !== "ArrowRight" || !event.shiftKey) return;
      event.preventDefault();
      if (this.holder === null && !event.repeat && this.allowed()) this.holder = -1;
    });
    for (const end of ["keyup", "blur"]) {
      this.slider.addEventListener(end, () => {
        if (this.holder === -1) this.release();
      });
    }
    addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => this.release());
  }

  box() {
    const box = this.slider.getBoundingClientRect();
    const travel = Math.max(1, box.width - box.height);
    return { travel, thumb: box.left + box.height / 2 + this.at * travel, height: box.height };
  }

  /** @param {number} at 0 at rest, 1 at the end */
  move(at) {
    this.at = Math.min(1, Math.max(0, at));
    const ends = this.at >= END;
    if (ends && Number.isNaN(this.heldMs)) this.begin();
    if (!ends) this.heldMs = NaN;
    this.show();
  }

  /** Begin to hold at the end: ask the server for the number that the kill must carry. */
  begin() {
    this.heldMs = performance.now();
    this.nonce = "";
    this.name = this.vehicle();
    const held = this.heldMs;
    this.commands.askKill(this.name, (message) => {
      if (held !== this.heldMs || message.vehicle !== this.name) return;
      this.nonce = message.nonce;
      this.fromMs = performance.now() + 1000 * message.after_s; // later than the hold's end if the question was slow
    });
  }

  tick() {
    if (this.holder === null) return;
    if (this.holder === -1) this.move(this.at + TICK_MS / KEY_TRAVEL_MS);
    const heldMs = performance.now() - this.heldMs;
    const answered = this.nonce !== "" && performance.now() >= this.fromMs;
    if (heldMs >= HOLD_MS && this.name === this.vehicle() && answered) {
      this.commands.send(this.name, "kill", { confirm: "kill", nonce: this.nonce });
      this.release();
    }
    this.show();
  }

  release() {
    this.holder = null;
    this.heldMs = NaN;
    this.nonce = "";
    this.at = 0;
    this.show();
  }

  show() {
    const heldMs = performance.now() - this.heldMs;
    const left = Number.isNaN(heldMs) ? "" : `hold ${Math.max(0, (HOLD_MS - heldMs) / 1000).toFixed(1)} s`;
    setText(byId("kill-text"), left || `Kill ${this.several() ? this.vehicle() : ""}: slide, hold 2 s`.replace(" :", ":"));
    this.slider.style.setProperty("--at", String(this.at));
    this.slider.style.setProperty("--held", String(Number.isNaN(heldMs) ? 0 : Math.min(1, heldMs / HOLD_MS)));
    setAttribute(this.slider, "aria-valuenow", String(Math.round(this.at * 100)));
    setAttribute(this.slider, "aria-valuetext", left || "at rest; hold Shift and the right arrow");
  }
}
