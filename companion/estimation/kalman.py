"""Kalman filter of a motion whose acceleration wanders: position, velocity, acceleration, driven by white jerk.

The axes are alike and independent, so one 3x3 covariance serves them all, and its six numbers are plain floats:
closed forms are several times cheaper here than matrix calls. Source: Bar-Shalom, Li, Kirubarajan, "Estimation with
Applications to Tracking and Navigation" (2001), section 6.2.3 (continuous Wiener process acceleration model).

In steady state, with measurement noise sigma every dt, all three poles lie at
w = (density / (sigma^2 dt))^(1/6) rad/s, and the velocity's standard deviation is sqrt(3 w^3 sigma^2 dt).
"""

from dataclasses import dataclass

from companion.types import Array


@dataclass(frozen=True)
class Covariance:
    """Of position (p), velocity (v), acceleration (a) of one axis: a symmetric 3x3 matrix."""

    pp: float
    pv: float
    pa: float
    vv: float
    va: float
    aa: float


@dataclass(frozen=True)
class Motion:
    """Estimate at one instant; vectors (..., 3), in any frame and unit; the axes and vehicles share `covariance`."""

    position: Array
    velocity: Array
    acceleration: Array
    """What the known input does not explain; all of it when no input is given."""
    covariance: Covariance


def grow(c: Covariance, dt: float, density: float) -> Covariance:
    """F P F' + Q over `dt` seconds; `density` of the jerk in unit^2/s^5."""
    half = 0.5 * dt * dt
    pa, va = c.pa + dt * c.va + half * c.aa, c.va + dt * c.aa
    pv = c.pv + dt * c.vv + half * c.va + dt * pa
    pp = c.pp + dt * (2.0 * c.pv + dt * (c.vv + c.pa) + half * (2.0 * c.va)) + half * half * c.aa
    q = density * dt
    return Covariance(
        pp + q * dt**4 / 20.0,
        pv + q * dt**3 / 8.0,
        pa + q * dt**2 / 6.0,
        c.vv + dt * (2.0 * c.va + dt * c.aa) + q * dt**2 / 3.0,
        va + q * dt / 2.0,
        c.aa + q,
    )


def gains(c: Covariance, variance: float) -> tuple[float, float, float]:
    """How far a unit of surprise in the position moves position, velocity and acceleration."""
    total = c.pp + variance
    return c.pp / total, c.pv / total, c.pa / total


def shrink(c: Covariance, variance: float) -> Covariance:
    """P after a measurement of the position with `variance` (unit^2)."""
    kp, kv, ka = gains(c, variance)
    return Covariance(variance * kp, variance * kv, variance * ka, c.vv - kv * c.pv, c.va - kv * c.pa, c.aa - ka * c.pa)


def predict(state: Motion, dt: float, density: float, accel_input: Array | None = None) -> Motion:
    """Carry the estimate `dt` seconds on; `accel_input` is acceleration known from elsewhere, shape (..., 3)."""
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
    kp, kv, ka = gains(state.covariance, variance)
    return Motion(
        state.position + kp * surprise,
        state.velocity + kv * surprise,
        state.acceleration + ka * surprise,
        shrink(state.covariance, variance),
    )
