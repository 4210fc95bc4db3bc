"""Identification of hover thrust, thrust curve and rotor delay."""

from dataclasses import dataclass

import numpy as np

from companion.analysis.calibration.fitting import Fit, fit
from companion.analysis.calibration.signals import Observed, blocks, smooth_held
from companion.core.types import Array

_STEP_S = 0.005
_BLOCK_S = 3.0
_NARROW_S, _WIDE_S = 0.06, 0.5
"""Standard deviations of the two averages whose difference is used: slower motion comes from disturbances, faster
motion is noise of the second derivative."""
_SLOW_MPS = 0.15
_DRY_MPS = 0.04
"""Speed over which dry friction changes its sign."""
_NEARLY = 0.999
_FIRST = np.array([0.08, 0.05, 0.1, 0.1, 0.05])
_STEPS = np.array([0.002, 0.004, 0.02, 0.02, 0.01])
_BOUNDS = (np.array([0.0, 0.001, -0.5, -2.0, -0.5]), np.array([0.4, 0.3, 1.5, 3.0, 0.5]))
_WINDOW_S = 2.0
_LEAST_WINDOWS = 5


@dataclass(frozen=True)
class Hover:
    """Hover thrust from the blocks of time with little vertical speed."""

    thrust: float
    sd: float
    """Standard deviation of the mean."""
    spread: float
    """Standard deviation over the flight, averaged over seconds: battery, room, and law."""
    for_s: float


def hover(seen: Observed, gravity_mps2: float) -> Hover | None:
    """Return the level thrust that carries the weight; None when the vehicle never hovered for long enough."""
    grid_s, height, cosine, thrust = _on_grid(seen)
    lift = thrust * cosine
    velocity = np.gradient(_averaged(height, 0.1), _STEP_S)
    quiet = np.interp(grid_s, seen.came_s, seen.quiet.astype(np.float64)) > _NEARLY
    calm = (np.abs(velocity) < _SLOW_MPS) & quiet
    window = blocks(grid_s, _WINDOW_S)
    means = []
    for number in np.unique(window)[:-1]:  # the last one is not whole
        here = np.flatnonzero(window == number)
        if calm[here].all():
            gained_mps2 = (velocity[here[-1]] - velocity[here[0]]) / (grid_s[here[-1]] - grid_s[here[0]])
            means.append(float(lift[here].mean()) / (1.0 + gained_mps2 / gravity_mps2))
    if len(means) < _LEAST_WINDOWS:
        return None
    values = np.array(means)
    off = values - values.mean()
    correlation = float((off[1:] * off[:-1]).sum() / max((off * off).sum(), 1e-12))
    alike = 1.0 + 2.0 * max(0.0, correlation)  # neighbours are: the room pushes for seconds
    spread = float(values.std(ddof=1))
    return Hover(float(values.mean()), spread * float(np.sqrt(alike / len(values))), spread, _WINDOW_S * len(values))


def _on_grid(seen: Observed) -> tuple[Array, Array, Array, Array]:
    """Return times, height, cosine of the tilt, and commanded thrust; (n,)."""
    grid_s = np.arange(seen.came_s[0], seen.came_s[-1], _STEP_S)
    height = np.interp(grid_s, seen.came_s, seen.position_w_m[:, 2])
    cosine = np.interp(grid_s, seen.came_s, seen.up_w[:, 2])
    return grid_s, height, cosine, smooth_held(grid_s, seen.sent_s, seen.sent_thrust)


def _kernel(sd_s: float) -> Array:
    t = np.arange(-4.0 * sd_s, 4.0 * sd_s + _STEP_S / 2, _STEP_S)
    bell = np.exp(-0.5 * (t / sd_s) ** 2)
    return np.asarray(bell / bell.sum())


def _averaged(values: Array, sd_s: float) -> Array:
    kernel = _kernel(sd_s)
    wide = np.pad(values, len(kernel) // 2, mode="edge")
    size = 1 << len(wide).bit_length()
    done = np.fft.irfft(np.fft.rfft(wide, size * 2) * np.fft.rfft(kernel, size * 2), size * 2)
    return np.asarray(done[len(kernel) - 1 : len(kernel) - 1 + len(values)])


def _band(values: Array) -> Array:
    return _averaged(values, _NARROW_S) - _averaged(values, _WIDE_S)


@dataclass(frozen=True)
class Rotors:
    """Thrust parameters identified from a flight with vertical motion."""

    fit: Fit
    """Delay from setpoint to the frame's arrival with the rotors' lag (s), the lag alone (s), the curve's f, drag (1/s)
    and dry friction (m/s^2), (5,)."""
    varied: float
    """Standard deviation of the thrust in the band that is used, as a share of hover thrust."""


def fit_rotors(seen: Observed, hover_thrust: float, gravity_mps2: float) -> Rotors:
    """Fit the vertical motion to the commanded thrust.

    The curve shows in how much more force a little more thrust gives, beside what carries the weight. Drag and dry
    friction are fitted along: left out they would be taken for lag and curve.
    """
    grid_s, height, cosine, thrust = _on_grid(seen)
    speed = np.gradient(_band(height), _STEP_S)
    did = np.gradient(speed, _STEP_S)
    dry = _band(np.tanh(np.gradient(_averaged(height, _NARROW_S), _STEP_S) / _DRY_MPS))
    quiet = np.interp(grid_s, seen.came_s, seen.quiet.astype(np.float64)) > _NEARLY
    shown = quiet & (grid_s > grid_s[0] + 4.0 * _WIDE_S) & (grid_s < grid_s[-1] - 4.0 * _WIDE_S)
    size = 2 << len(grid_s).bit_length()
    turns = 1j * np.fft.rfftfreq(size, _STEP_S) * 2.0 * np.pi

    def residuals(values: Array) -> Array:
        total_s, lag_s, curve, drag, friction = values
        weight = curve * hover_thrust**2 + (1.0 - curve) * hover_thrust
        more = (curve * thrust**2 + (1.0 - curve) * thrust) / weight - 1.0
        late = np.exp(-turns * (total_s - lag_s)) / (1.0 + turns * lag_s)
        lift = (1.0 + np.fft.irfft(np.fft.rfft(more, size) * late, size)[: len(grid_s)]) * cosine
        return np.asarray((did - _band(gravity_mps2 * lift) + drag * speed + friction * dry)[shown])

    power = float((did[shown] ** 2).mean())
    found = fit(residuals, _FIRST, _STEPS, _BOUNDS, blocks(grid_s[shown], _BLOCK_S), power)
    return Rotors(found, float(_band(thrust)[shown].std() / hover_thrust))
