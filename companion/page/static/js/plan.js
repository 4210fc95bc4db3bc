// The room from above: x to the right, y up; a tap chooses a place for "go to".

import { attitude, circle, placed, rotors } from "./body.js";
import { begin, label, line } from "./canvas.js";
import { fenceOf, strangers, trailLine, vehicleColour } from "./room.js";
import { colour } from "./theme.js";

const EDGE_PX = 22;

/** @param {HTMLCanvasElement} canvas @param {any} fence */
function scaleOf(canvas, fence) {
  const [[x0, x1], [y0, y1]] = [fence.x_m, fence.y_m];
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const perM = Math.min((width - 2 * EDGE_PX) / (x1 - x0), (height - 2 * EDGE_PX) / (y1 - y0));
  const [middleX, middleY] = [(x0 + x1) / 2, (y0 + y1) / 2];
  return {
    perM,
    project: (/** @type {number[]} */ p) => [width / 2 + (p[0] - middleX) * perM, height / 2 - (p[1] - middleY) * perM],
    place: (/** @type {number} */ x, /** @type {number} */ y) => [
      (x - width / 2) / perM + middleX,
      (height / 2 - y) / perM + middleY,
    ],
  };
}

/**
 * Return the place in W, m, to 1 cm, that a pointer is on; null outside the fence.
 * @param {HTMLCanvasElement} canvas @param {import("./fleet.js").Fleet} fleet @param {MouseEvent} event
 */
export function placeOf(canvas, fleet, event) {
  const fence = fenceOf(fleet);
  const box = canvas.getBoundingClientRect();
  const [x, y] = scaleOf(canvas, fence).place(event.clientX - box.left, event.clientY - box.top);
  const inside = x >= fence.x_m[0] && x <= fence.x_m[1] && y >= fence.y_m[0] && y <= fence.y_m[1];
  return inside ? [Math.round(x * 100) / 100, Math.round(y * 100) / 100] : null;
}

/** Draw everything. @param {HTMLCanvasElement} canvas @param {import("./fleet.js").Fleet} fleet */
export function drawPlan(canvas, fleet) {
  const screen = begin(canvas);
  if (screen === null) return;
  const { context } = screen;
  const { project, perM } = scaleOf(canvas, fenceOf(fleet));
  drawFloor(context, project, fenceOf(fleet));
  for (const other of strangers(fleet)) {
    const at = project(other.position_w_m);
    line(context, circle([...at, 0], 0.4 * perM), colour("soft"), 2);
    label(context, other.body, at, { fill: colour("soft"), halo: colour("canvas"), align: "center", size: 13 });
  }
  const vehicles = [...fleet.vehicles.values()];
  vehicles.forEach((vehicle, index) => {
    drawOne(context, project, vehicle, { fill: vehicleColour(index), bold: vehicle === fleet.focus });
    const at = vehicle.state?.position_w_m;
    if (!at || vehicles.length === 1) return;
    const above = project([at[0], at[1] + 0.75]);
    label(context, vehicle.name, above, { fill: vehicleColour(index), halo: colour("canvas"), align: "center", bold: true });
  });
}

/** @param {CanvasRenderingContext2D} context @param {(p: number[]) => number[]} project @param {any} fence */
function drawFloor(context, project, fence) {
  const [[x0, x1], [y0, y1]] = [fence.x_m, fence.y_m];
  const [left, top] = project([x0, y1]);
  const [right, bottom] = project([x1, y0]);
  context.fillStyle = colour("floor");
  context.fillRect(left, top, right - left, bottom - top);
  const ink = { fill: colour("soft"), halo: colour("canvas"), size: 12 };
  for (let x = Math.ceil(x0); x <= x1; x += 1) {
    line(context, [project([x, y0]), project([x, y1])], colour("grid"), x === 0 ? 2 : 1);
    if (x % 2 === 0) label(context, `${x}`, [project([x, y0])[0], bottom + 11], { ...ink, align: "center" });
  }
  for (let y = Math.ceil(y0); y <= y1; y += 1) {
    line(context, [project([x0, y]), project([x1, y])], colour("grid"), y === 0 ? 2 : 1);
    if (y % 2 === 0) label(context, `${y}`, [left - 6, project([x0, y])[1]], { ...ink, align: "right" });
  }
  context.strokeStyle = colour("fence");
  context.lineWidth = 2.5;
  context.strokeRect(left, top, right - left, bottom - top);
  label(context, "x", [right + 10, bottom], { ...ink, align: "center", bold: true });
  label(context, "y", [left, top - 11], { ...ink, align: "center", bold: true });
}

/**
 * @param {CanvasRenderingContext2D} context @param {(p: number[]) => number[]} project @param {any} vehicle
 * @param {{fill: string, bold: boolean}} own
 */
function drawOne(context, project, vehicle, own) {
  const { state } = vehicle;
  const at = state?.position_w_m;
  if (at) {
    line(context, trailLine(vehicle.trail, project), own.fill, own.bold ? 2.5 : 1.5);
    drawFrame(context, project, vehicle, own.fill);
    if (state.reference_w_m) drawDiamond(context, project(state.reference_w_m));
  }
  if (!vehicle.target) return;
  const goal = project(vehicle.target);
  if (at) line(context, [project(at), goal], colour("target"), 2, [6, 5]);
  line(context, circle([...goal, 0], 11), colour("target"), 3);
  for (const [x, y] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    line(context, [[goal[0] + 6 * x, goal[1] + 6 * y], [goal[0] + 17 * x, goal[1] + 17 * y]], colour("target"), 3);
  }
}

/** @param {CanvasRenderingContext2D} context @param {(p: number[]) => number[]} project @param {any} vehicle @param {string} fill */
function drawFrame(context, project, vehicle, fill) {
  const { state } = vehicle;
  const q = attitude(state);
  const to = (/** @type {number[]} */ p) => project(placed(q, state.position_w_m, p));
  const { centres, radius } = rotors(vehicle.about);
  for (const side of ["left", "right"]) {
    const joints = vehicle.armsB?.[side];
    if (joints?.length) line(context, joints.map(to), colour("arm"), 4);
  }
  for (const centre of centres) {
    line(context, [to([0, 0, 0]), to(centre)], fill, 3);
    line(context, circle(centre, radius).map(to), fill, 2);
  }
  line(context, [to([0, 0, 0]), to([0.5, 0, 0])], colour("ink"), 3); // its nose
}

/** @param {CanvasRenderingContext2D} context @param {number[]} at */
function drawDiamond(context, at) {
  const corners = [[0, -7], [7, 0], [0, 7], [-7, 0], [0, -7]];
  line(context, corners.map(([x, y]) => [at[0] + x, at[1] + y]), colour("reference"), 2.5);
}
