"""Kalman filter with states position, velocity, acceleration, driven by white jerk.

The axes are alike and independent, so one 3x3 covariance serves them all, and its six numbers are plain floats:
closed forms are several times cheaper here than matrix calls. A batch shares them as long as its vehicles have seen
the same frames; after that they are arrays. Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to
Tracking and Navigation" (2001), section 6.2.3 (continuous Wiener process acceleration model).

In steady state, with measurement noise sigma every dt, all three poles lie at
w = (density / (sigma^2 dt))^(1/6) rad/s, and the velocity's standard deviation is sqrt(3 w^3 sigma^2 dt).
"""

from companion.core.types import Scalar
from companion.core.values import value
from companion.geometry.array_math import Components, along_axes

Gains = tuple[Scalar, Scalar, Scalar]
"""Correction of position, velocity and acceleration per unit of innovation in the position."""


@value
class Covariance:
    """Covariance of position (p), velocity (v), acceleration (a) of one axis: a symmetric 3x3 matrix."""

    pp: Scalar
    pv: Scalar
    pa: Scalar
    vv: Scalar
    va: Scalar
    aa: Scalar


@value
class Motion:
    """Estimate at one instant; vectors in any frame and unit."""

    position: Components
    velocity: Components
    acceleration: Components
    """Part not explained by the known input; the whole acceleration without an input."""
    covariance: Covariance
    """Covariance of every axis: floats shared by the vehicles, or one per vehicle, (..., 1)."""


def first_covariance(noise: float) -> Covariance:
    """Return the covariance after one position of this deviation: at rest, to within 1 unit/s and 5 unit/s^2."""
    return Covariance(noise * noise, 0.0, 0.0, 1.0, 0.0, 25.0)


def grow(c: Covariance, dt: Scalar, density: float) -> Covariance:
    """Return F P F' + Q over `dt` seconds; `density` of the jerk in unit^2/s^5."""
    half = 0.5 * dt * dt
    pv, pa = c.pv + dt * c.vv + half * c.va, c.pa + dt * c.va + half * c.aa
    va = c.va + dt * c.aa  # F P, whose elements above the diagonal these are
    q = density * dt
    by_half = q * half
    return Covariance(
        c.pp + dt * (c.pv + pv) + half * (c.pa + pa) + by_half * half / 5.0,
        pv + dt * pa + by_half * dt / 4.0,
        pa + by_half / 3.0,
        c.vv + dt * (c.va + va) + by_half / 1.5,
        va + density * half,
        c.aa + q,
    )


def shrink(c: Covariance, variance: float) -> tuple[Gains, Covariance]:
    """Return the gains of a position measurement with `variance` (unit^2), and P after it."""
    total = c.pp + variance
    kp, kv, ka = c.pp / total, c.pv / total, c.pa / total
    left = Covariance(variance * kp, variance * kv, variance * ka, c.vv - kv * c.pv, c.va - kv * c.pa, c.aa - ka * c.pa)
    return (kp, kv, ka), left


def predict(state: Motion, dt: Scalar, density: float, accel_input: Components | None = None) -> Motion:
    """Predict the estimate after `dt` s, () or (..., 1); `accel_input`, as the vectors, is known acceleration."""
    half = 0.5 * dt * dt

    def ahead(position: Scalar, velocity: Scalar, acceleration: Scalar) -> tuple[Scalar, ...]:
        return position + dt * velocity + half * acceleration, velocity + dt * acceleration

    acceleration = state.acceleration
    if accel_input is not None:
        (acceleration,) = along_axes(lambda own, known: (own + known,), acceleration, accel_input)
    position, velocity = along_axes(ahead, state.position, state.velocity, acceleration)
    return Motion(position, velocity, state.acceleration, grow(state.covariance, dt, density))


def update(state: Motion, measured: Components, variance: float) -> Motion:
    """Correct the estimate by a measured position, as the vectors, with `variance` (unit^2) on every axis."""
    (kp, kv, ka), covariance = shrink(state.covariance, variance)

    def corrected(position: Scalar, velocity: Scalar, acceleration: Scalar, measured: Scalar) -> tuple[Scalar, ...]:
        innovation = measured - position
        return position + kp * innovation, velocity + kv * innovation, acceleration + ka * innovation

    vectors = state.position, state.velocity, state.acceleration
    position, velocity, acceleration = along_axes(corrected, *vectors, measured)
    return Motion(position, velocity, acceleration, covariance)
