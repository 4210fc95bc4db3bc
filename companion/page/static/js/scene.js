// The room in 3D: fence, floor, vehicles with rotors and arms, references, trails, other bodies.

import { attitude, circle, placed, rotors } from "./body.js";
import { begin, label, line } from "./canvas.js";
import { fenceOf, strangers, trailLine, vehicleColour } from "./room.js";
import { colour } from "./theme.js";

/** @typedef {(p: number[]) => number[] | null} Project */

/**
 * Draw everything.
 * @param {HTMLCanvasElement} canvas
 * @param {import("./fleet.js").Fleet} fleet
 * @param {import("./camera.js").Camera} camera
 * @param {boolean} follow
 */
export function drawScene(canvas, fleet, camera, follow) {
  const screen = begin(canvas);
  if (screen === null) return;
  const fence = fenceOf(fleet);
  aim(camera, fence, follow ? fleet.focus?.state?.position_w_m : null);
  const project = camera.projection(screen.width, screen.height);
  drawRoom(screen.context, project, fence);
  for (const other of strangers(fleet)) drawStranger(screen.context, project, other);
  const vehicles = [...fleet.vehicles.values()];
  vehicles.forEach((vehicle, index) => {
    const own = { fill: vehicleColour(index), named: vehicles.length > 1, bold: vehicle === fleet.focus };
    drawVehicle(screen.context, project, vehicle, own);
  });
  if (!follow) drawCloseUp(screen, fleet, camera);
}

/**
 * Draw the vehicle in view once more, near, in a corner: attitude and arms are too small in a large room.
 * @param {{context: CanvasRenderingContext2D, width: number, height: number}} screen
 * @param {import("./fleet.js").Fleet} fleet @param {import("./camera.js").Camera} camera
 */
function drawCloseUp({ context, width, height }, fleet, camera) {
  const vehicle = fleet.focus;
  const at = vehicle?.state?.position_w_m;
  if (!vehicle || !at) return;
  const side = Math.min(width * 0.36, height * 0.48);
  const own = vehicleColour([...fleet.vehicles.values()].indexOf(vehicle));
  context.save();
  context.beginPath();
  context.roundRect(1, 1, side, side, 8);
  context.fillStyle = colour("canvas");
  context.fill();
  context.strokeStyle = colour("grid");
  context.lineWidth = 2;
  context.stroke();
  context.clip();
  drawBody(context, camera.around([at[0], at[1], at[2] - 0.06], 1.75, side), vehicle, own);
  context.restore();
}

/** @param {import("./camera.js").Camera} camera @param {any} fence @param {number[] | null | undefined} at */
function aim(camera, fence, at) {
  const [x, y] = [fence.x_m, fence.y_m];
  camera.centre = at ?? [(x[0] + x[1]) / 2, (y[0] + y[1]) / 2, fence.top_m * 0.33];
  camera.reach = (at ? 0.4 : 1.25) * Math.hypot(x[1] - x[0], y[1] - y[0], fence.top_m);
}

/** @param {CanvasRenderingContext2D} context @param {Project} project @param {any} fence */
function drawRoom(context, project, fence) {
  const [[x0, x1], [y0, y1], top] = [fence.x_m, fence.y_m, fence.top_m];
  const floor = [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]].map(project);
  if (floor.every((point) => point !== null)) {
    context.beginPath();
    floor.forEach((point) => context.lineTo(/** @type {any} */ (point)[0], /** @type {any} */ (point)[1]));
    context.fillStyle = colour("floor");
    context.fill();
  }
  for (let x = Math.ceil(x0); x <= x1; x += 1) line(context, [[x, y0, 0], [x, y1, 0]].map(project), colour("grid"), 1);
  for (let y = Math.ceil(y0); y <= y1; y += 1) line(context, [[x0, y, 0], [x1, y, 0]].map(project), colour("grid"), 1);
  const net = colour("fence");
  for (const z of [0, top]) {
    const ring = [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z], [x0, y0, z]];
    line(context, ring.map(project), net, z === 0 ? 2.5 : 1.5);
  }
  for (const [x, y] of [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) {
    line(context, [[x, y, 0], [x, y, top]].map(project), net, 1.5);
  }
  const ink = { fill: colour("soft"), halo: colour("canvas"), size: 13, bold: true };
  for (const [text, axis] of /** @type {[string, number[]][]} */ ([["x", [1, 0, 0]], ["y", [0, 1, 0]]])) {
    line(context, [[0, 0, 0], axis].map(project), colour("soft"), 2.5);
    const end = project(axis.map((value) => value * 1.25));
    if (end !== null) label(context, text, end, { ...ink, align: "center" });
  }
}

/**
 * @param {CanvasRenderingContext2D} context @param {Project} project @param {any} vehicle
 * @param {{fill: string, named: boolean, bold: boolean}} own
 */
function drawVehicle(context, project, vehicle, own) {
  const at = vehicle.state?.position_w_m;
  if (!at) return;
  line(context, trailLine(vehicle.trail, project), own.fill, own.bold ? 2.5 : 1.5);
  drawReference(context, project, vehicle.state.reference_w_m, at);
  if (vehicle.target) drawTarget(context, project, vehicle.target, at[2]);
  const ground = [at[0], at[1], 0];
  line(context, [at, ground].map(project), colour("soft"), 1.5, [3, 5]);
  line(context, circle(ground, 0.2).map(project), colour("soft"), 1.5);
  drawBody(context, project, vehicle, own.fill);
  const head = project([at[0], at[1], at[2] + 0.45]);
  if (own.named && head !== null) {
    label(context, vehicle.name, head, { fill: own.fill, halo: colour("canvas"), align: "center", bold: own.bold });
  }
}

/** @param {CanvasRenderingContext2D} context @param {Project} project @param {any} vehicle @param {string} fill */
function drawBody(context, project, vehicle, fill) {
  const { state } = vehicle;
  const q = attitude(state);
  const to = (/** @type {number[]} */ p) => project(placed(q, state.position_w_m, p));
  const { centres, radius } = rotors(vehicle.about);
  const near = Math.min(2.2, Math.max(1, 8 / (to([0, 0, 0])?.[2] ?? 8)));
  for (const side of ["left", "right"]) drawArm(context, vehicle.armsB?.[side], to, near);
  for (const centre of centres) line(context, [[0, 0, centre[2] / 2], centre].map(to), fill, 2.2 * near);
  line(context, [to([0, 0, 0]), to([0.32, 0, 0])], colour("ink"), 2.5 * near); // its nose
  for (const centre of centres) drawRotor(context, circle(centre, radius).map(to), fill, state.armed === true);
  const middle = to([0, 0, 0]);
  if (middle !== null) dot(context, middle, 2.6 * near, fill);
}

/** @param {CanvasRenderingContext2D} context @param {(number[] | null)[]} ring @param {string} fill @param {boolean} turns */
function drawRotor(context, ring, fill, turns) {
  if (turns && ring.every((point) => point !== null)) {
    context.globalAlpha = 0.28;
    context.beginPath();
    ring.forEach((point) => context.lineTo(/** @type {any} */ (point)[0], /** @type {any} */ (point)[1]));
    context.fillStyle = fill;
    context.fill();
    context.globalAlpha = 1;
  }
  line(context, ring, fill, 1.6);
}

/** @param {CanvasRenderingContext2D} context @param {any} joints @param {(p: number[]) => number[] | null} to @param {number} near */
function drawArm(context, joints, to, near) {
  if (!joints || joints.length === 0) return;
  const points = joints.map(to);
  line(context, [to([0, joints[0][1], 0]), ...points], colour("arm"), 2.6 * near);
  for (const point of points) if (point !== null) dot(context, point, 1.7 * near, colour("arm"));
}

/** @param {CanvasRenderingContext2D} context @param {number[]} at @param {number} radius @param {string} fill */
function dot(context, at, radius, fill) {
  context.beginPath();
  context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
  context.fillStyle = fill;
  context.fill();
}

/** @param {CanvasRenderingContext2D} context @param {Project} project @param {any} reference @param {number[]} at */
function drawReference(context, project, reference, at) {
  const point = reference ? project(reference) : null;
  if (point === null) return;
  line(context, [project(at), point], colour("reference"), 1.5, [2, 4]);
  const size = 7;
  const diamond = [[0, -size], [size, 0], [0, size], [-size, 0], [0, -size]];
  line(context, diamond.map(([x, y]) => [point[0] + x, point[1] + y]), colour("reference"), 2.5);
}

/** @param {CanvasRenderingContext2D} context @param {Project} project @param {number[]} target @param {number} height */
function drawTarget(context, project, target, height) {
  const z = target[2] ?? height;
  const place = [target[0], target[1], z];
  line(context, [place, [place[0], place[1], 0]].map(project), colour("target"), 2, [6, 4]);
  line(context, circle(place, 0.18).map(project), colour("target"), 3);
}

/** @param {CanvasRenderingContext2D} context @param {Project} project @param {any} other */
function drawStranger(context, project, other) {
  const [x, y, z] = other.position_w_m;
  for (const height of [z - 0.25, z + 0.25]) line(context, circle([x, y, height], 0.4).map(project), colour("soft"), 2);
  const head = project([x, y, z + 0.5]);
  if (head !== null) label(context, other.body, head, { fill: colour("soft"), halo: colour("canvas"), align: "center" });
}
