"""quaternion.py's maths for exactly one quaternion, in plain floats; conventions are the same."""

from mock_autopilot.physics.components import maths, where

Four = tuple[float, float, float, float]
Three = tuple[float, float, float]


def multiply(a: Four, b: Four) -> Four:
    """Return the Hamilton product of two quaternions w x y z."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def unit(q: Four) -> Four:
    """Scale a quaternion to length 1."""
    w, x, y, z = q
    per_length = 1.0 / maths(w).sqrt(w * w + x * x + y * y + z * z)
    return w * per_length, x * per_length, y * per_length, z * per_length


def yaw_of(q: Four) -> float:
    """Return the heading (rad)."""
    w, x, y, z = q
    return float(maths(w).atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def to_rotation_vector(q: Four) -> Three:
    """Convert a unit quaternion to the shorter rotation vector (rad) (logarithm)."""
    w, x, y, z = q
    m = maths(w)
    sine = m.sqrt(x * x + y * y + z * z)
    turns = sine > 1e-12
    scale = m.copysign(2.0, w) * where(turns, m.atan2(sine, abs(w)) / where(turns, sine, 1.0), 1.0)
    return scale * x, scale * y, scale * z
