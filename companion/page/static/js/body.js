// The vehicle as lines: rotors, frame and arms in body axes (forward, left, up), turned into W.

/**
 * Turn a point of the body into W.
 * @param {number[]} q attitude, w x y z
 * @param {number[]} at position in W, m
 * @param {number[]} p point in the body, m
 */
export function placed(q, at, p) {
  const [w, x, y, z] = q;
  const tx = 2 * (y * p[2] - z * p[1]);
  const ty = 2 * (z * p[0] - x * p[2]);
  const tz = 2 * (x * p[1] - y * p[0]);
  return [
    at[0] + p[0] + w * tx + y * tz - z * ty,
    at[1] + p[1] + w * ty + z * tx - x * tz,
    at[2] + p[2] + w * tz + x * ty - y * tx,
  ];
}

/** Return the attitude of a state, w x y z; level with its heading where it is not told. @param {any} state */
export function attitude(state) {
  if (state.q_w_flu_wxyz) return state.q_w_flu_wxyz;
  const half = (state.yaw_rad ?? 0) / 2;
  return [Math.cos(half), 0, 0, Math.sin(half)];
}

/**
 * Return the rotors of a vehicle: centres and radius in body axes, m.
 * @param {any} about
 */
export function rotors(about) {
  const discs = about?.arms?.propellers ?? {};
  const footprint = about?.footprint_m ?? 0.5;
  const count = discs.count ?? 4;
  const out = discs.centre_m ?? 0.66 * footprint;
  const first = discs.first_rad ?? Math.PI / 4;
  const height = discs.height_m ?? 0.06;
  const centres = Array.from({ length: count }, (_, i) => {
    const angle = first + (2 * Math.PI * i) / count;
    return [out * Math.cos(angle), out * Math.sin(angle), height];
  });
  return { centres, radius: discs.radius_m ?? 0.34 * footprint };
}

/**
 * Return points of a level circle around a centre, closed.
 * @param {number[]} centre @param {number} radius @param {number} [count]
 */
export function circle(centre, radius, count = 24) {
  return Array.from({ length: count + 1 }, (_, i) => {
    const angle = (2 * Math.PI * i) / count;
    return [centre[0] + radius * Math.cos(angle), centre[1] + radius * Math.sin(angle), centre[2]];
  });
}
