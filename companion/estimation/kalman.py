"""Kalman filter of a motion whose acceleration wanders: position, velocity, acceleration, driven by white jerk.

The axes are alike and independent, so one 3x3 covariance serves them all, and its six numbers are plain floats:
closed forms are several times cheaper here than matrix calls. A batch shares them as long as its vehicles have seen
the same frames; after that they are arrays. Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to
Tracking and Navigation" (2001), section 6.2.3 (continuous Wiener process acceleration model).

In steady state, with measurement noise sigma every dt, all three poles lie at
w = (density / (sigma^2 dt))^(1/6) rad/s, and the velocity's standard deviation is sqrt(3 w^3 sigma^2 dt).
"""

from companion.control.switching import Scalar
from companion.control.values import value
from companion.types import Array

Gains = tuple[Scalar, Scalar, Scalar]
"""How far a unit of surprise in the position moves position, velocity and acceleration."""


@value
class Covariance:
    """Of position (p), velocity (v), acceleration (a) of one axis: a symmetric 3x3 matrix."""

    pp: Scalar
    pv: Scalar
    pa: Scalar
    vv: Scalar
    va: Scalar
    aa: Scalar


@value
class Motion:
    """Estimate at one instant; vectors (..., 3), in any frame and unit."""

    position: Array
    velocity: Array
    acceleration: Array
    """What the known input does not explain; all of it when no input is given."""
    covariance: Covariance
    """Of every axis: floats that the vehicles share, or each vehicle's own, (..., 1)."""


def grow(c: Covariance, dt: Scalar, density: float) -> Covariance:
    """F P F' + Q over `dt` seconds; `density` of the jerk in unit^2/s^5."""
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
    """What a measurement of the position with `variance` (unit^2) does: the gains, and P after it."""
    total = c.pp + variance
    kp, kv, ka = c.pp / total, c.pv / total, c.pa / total
    left = Covariance(variance * kp, variance * kv, variance * ka, c.vv - kv * c.pv, c.va - kv * c.pa, c.aa - ka * c.pa)
    return (kp, kv, ka), left


def predict(state: Motion, dt: Scalar, density: float, accel_input: Array | None = None) -> Motion:
    """Carry the estimate `dt` seconds, () or (..., 1), on; `accel_input`, (..., 3), is acceleration known otherwise."""
    acceleration = state.acceleration if accel_input is None else state.acceleration + accel_input
    return Motion(
        state.position + dt * state.velocity + (0.5 * dt * dt) * acceleration,
        state.velocity + dt * acceleration,
        state.acceleration,
        grow(state.covariance, dt, density),
    )


def update(state: Motion, measured: Array, variance: float) -> Motion:
    """Correct by a measured position, shape (..., 3), with `variance` (unit^2) on every axis."""
    surprise = measured - state.position
    (kp, kv, ka), covariance = shrink(state.covariance, variance)
    return Motion(
        state.position + kp * surprise,
        state.velocity + kv * surprise,
        state.acceleration + ka * surprise,
        covariance,
    )
