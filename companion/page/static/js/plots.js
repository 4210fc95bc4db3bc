// Curves of the last 60 s: error, height, share of updates, age of the pose.

import { begin, label, line } from "./canvas.js";
import { make, setText } from "./dom.js";
import { SPAN_S } from "./fleet.js";
import { colour } from "./theme.js";

/**
 * @typedef {object} Plot
 * @property {string} name
 * @property {string} key
 * @property {string} unit
 * @property {number} times from SI
 * @property {number} digits
 * @property {number} least of the upper end of the axis
 * @property {string} [goal] key of a second curve
 */

/** @type {Plot[]} */
const PLOTS = [
  { name: "Error", key: "error", unit: "cm", times: 100, digits: 1, least: 5 },
  { name: "Height", key: "height", unit: "m", times: 1, digits: 2, least: 1.5, goal: "goal" },
  { name: "Updates", key: "share", unit: "%", times: 100, digits: 0, least: 100 },
  { name: "Age of pose", key: "age", unit: "ms", times: 1000, digits: 0, least: 40 },
];
/** Points farther apart than this are not joined, s. */
const GAP_S = 1;
const LEFT_PX = 40;

/** Make the figures. @param {HTMLElement} home */
export function makePlots(home) {
  return PLOTS.map((plot) => {
    const figure = make("figure");
    const caption = make("figcaption", "", "");
    const value = make("strong");
    const canvas = make("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${plot.name} over the last 60 s`);
    caption.append(`${plot.name} `, value);
    figure.append(caption, canvas);
    home.append(figure);
    return { ...plot, value, canvas };
  });
}

/** Draw the curves of one vehicle. @param {any[]} plots @param {any} vehicle */
export function drawPlots(plots, vehicle) {
  const samples = vehicle?.samples ?? [];
  const nowS = vehicle?.state ? vehicle.timeS : 0;
  for (const plot of plots) {
    const last = samples.at(-1)?.[plot.key];
    const known = typeof last === "number";
    setText(plot.value, known ? `${(last * plot.times).toFixed(plot.digits)} ${plot.unit}` : "–");
    drawPlot(plot, samples, nowS);
  }
}

/** Return a round number at or above a value. @param {number} value */
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 3, 5, 10].map((step) => step * power).find((step) => step >= value * 0.999) ?? value;
}

/** @param {any} plot @param {any[]} samples @param {number} nowS */
function drawPlot(plot, samples, nowS) {
  const screen = begin(plot.canvas);
  if (screen === null) return;
  const { context, width, height } = screen;
  const most = Math.max(plot.least, ...samples.map((one) => (one[plot.key] ?? 0) * plot.times));
  const top = roundUp(most);
  const [high, low] = [8, height - 16];
  const x = (/** @type {number} */ t) => LEFT_PX + ((t - nowS + SPAN_S) / SPAN_S) * (width - LEFT_PX - 6);
  const y = (/** @type {number} */ value) => low - (value / top) * (low - high);
  const ink = { fill: colour("soft"), halo: colour("canvas"), size: 12 };
  for (const share of [0, 0.5, 1]) {
    line(context, [[LEFT_PX, y(top * share)], [width - 6, y(top * share)]], colour("grid"), 1);
    label(context, `${+(top * share).toFixed(2)}`, [LEFT_PX - 5, y(top * share)], { ...ink, align: "right" });
  }
  for (const [ago, text] of /** @type {[number, string][]} */ ([[60, "−60 s"], [30, "−30"], [0, "now"]])) {
    const align = ago === 60 ? "left" : ago === 0 ? "right" : "center";
    label(context, text, [x(nowS - ago), height - 7], { ...ink, align });
  }
  if (plot.goal) line(context, curve(samples, plot.goal, plot.times, x, y), colour("reference"), 2, [4, 4]);
  line(context, curve(samples, plot.key, plot.times, x, y), colour("curve"), 2.5);
}

/**
 * @param {any[]} samples @param {string} key @param {number} times
 * @param {(t: number) => number} x @param {(value: number) => number} y
 */
function curve(samples, key, times, x, y) {
  /** @type {(number[] | null)[]} */
  const points = [];
  let before = -Infinity;
  for (const sample of samples) {
    const value = sample[key];
    if (value === null || sample.t - before > GAP_S) points.push(null);
    if (value !== null) points.push([Math.max(LEFT_PX, x(sample.t)), y(value * times)]);
    before = sample.t;
  }
  return points;
}
