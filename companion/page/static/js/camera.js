// A camera that turns around a point, and the pointers, wheel and keys that move it.

const START = { yaw: -2.2, pitch: 0.5, zoom: 1 };
const LEAST_PITCH = 0.03;
const MOST_PITCH = 1.54;
const FIELD = 1.25; // focal length in screen heights

export class Camera {
  /** @param {HTMLCanvasElement} canvas @param {() => void} onChange */
  constructor(canvas, onChange) {
    this.onChange = onChange;
    Object.assign(this, START);
    this.yaw = START.yaw;
    this.pitch = START.pitch;
    this.zoom = START.zoom;
    this.centre = [0, 0, 1];
    /** Distance at zoom 1, m. */
    this.reach = 12;
    /** @type {Map<number, number[]>} */
    this.pointers = new Map();
    this.listen(canvas);
  }

  reset() {
    Object.assign(this, START);
    this.onChange();
  }

  /** @param {number} yaw @param {number} pitch rad */
  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(MOST_PITCH, Math.max(LEAST_PITCH, this.pitch + pitch));
    this.onChange();
  }

  /** @param {number} factor above 1: nearer */
  nearer(factor) {
    this.zoom = Math.min(12, Math.max(0.4, this.zoom * factor));
    this.onChange();
  }

  /**
   * Return a projection of W onto a screen: (x, y, depth in m), or null behind the camera.
   * @param {number} width @param {number} height
   * @returns {(p: number[]) => number[] | null}
   */
  projection(width, height) {
    const focal = FIELD * Math.min(height, width * 0.8);
    return this.onto([width / 2, height / 2], focal, this.centre, this.reach / this.zoom);
  }

  /**
   * Return a projection onto a square in the corner, from the same side, around a point.
   * @param {number[]} centre @param {number} distance m @param {number} side
   */
  around(centre, distance, side) {
    return this.onto([side / 2, side / 2], FIELD * side, centre, distance);
  }

  /**
   * @param {number[]} middle of the screen @param {number} focal
   * @param {number[]} centre in W, m @param {number} distance m
   * @returns {(p: number[]) => number[] | null}
   */
  onto(middle, focal, [x0, y0, z0], distance) {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return (p) => {
      const [x, y, z] = [p[0] - x0, p[1] - y0, p[2] - z0];
      const right = -sy * x + cy * y;
      const back = cy * x + sy * y; // towards the camera, level
      const up = cp * z - sp * back;
      const depth = distance - (cp * back + sp * z);
      if (depth < 0.1) return null;
      return [middle[0] + (focal * right) / depth, middle[1] - (focal * up) / depth, depth];
    };
  }

  /** @param {HTMLCanvasElement} canvas */
  listen(canvas) {
    canvas.addEventListener("pointerdown", (event) => {
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (/** @type {any} */ event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.nearer(Math.exp(-event.deltaY * 0.0015));
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (before === undefined) return;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (other === undefined) {
      this.turn((before[0] - event.clientX) * 0.008, (event.clientY - before[1]) * 0.006);
      return;
    }
    const was = Math.hypot(before[0] - other[0], before[1] - other[1]);
    const is = Math.hypot(event.clientX - other[0], event.clientY - other[1]);
    if (was > 1 && is > 1) this.nearer(is / was);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const turns = { ArrowLeft: [0.12, 0], ArrowRight: [-0.12, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] };
    if (event.key in turns) this.turn(...turns[event.key]);
    else if (event.key === "+" || event.key === "=") this.nearer(1.2);
    else if (event.key === "-") this.nearer(1 / 1.2);
    else if (event.key === "0") this.reset();
    else return;
    event.preventDefault();
  }
}
