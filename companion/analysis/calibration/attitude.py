"""Fits of tilts over time: the delay of motion capture, and the attitude loop from setpoint to measured tilt."""

import numpy as np

from companion.analysis.calibration.fitting import Fit, fit
from companion.analysis.calibration.signals import Observed, blocks, smooth_held
from companion.core.types import Array

_STEP_S = 0.0025
_SETTLES_S = 1.5
_BLOCK_S = 3.0
_FIRST = np.array([0.05, 8.0, 0.8])
_BOUNDS = (np.array([-0.05, 1.5, 0.15]), np.array([0.5, 35.0, 2.0]))
_STEPS = np.array([0.001, 0.05, 0.01])


_BLOCK_S = 3.0


def fit_mocap_delay(seen: Observed) -> Fit:
    """Fit the delay from capture to arrival, less that of the autopilot's attitude, s: (1,).

    Both see the same tilt; motion capture's is shifted until they agree. A constant difference (the body's definition
    in QTM, the autopilot's level horizon) is taken out.
    """
    inside = (seen.came_s > seen.heard_s[0] + 0.5) & (seen.came_s < seen.heard_s[-1] - 0.5)
    at_s, ours = seen.came_s[inside], seen.up_w[inside, :2]
    moved = ours - ours.mean(axis=0)

    def residuals(values: Array) -> Array:
        theirs = np.column_stack(
            [np.interp(at_s - values[0], seen.heard_s, seen.autopilot_up_w[:, axis]) for axis in (0, 1)]
        )
        off = ours - theirs
        return np.asarray((off - off.mean(axis=0)).T.ravel())

    block = np.tile(blocks(at_s, _BLOCK_S), 2)
    first = min(np.linspace(-0.05, 0.25, 61), key=lambda delay_s: float((residuals(np.array([delay_s])) ** 2).sum()))
    bounds = (np.array([-0.1]), np.array([0.4]))
    return fit(residuals, np.array([first]), np.array([0.004]), bounds, block, float((moved**2).mean()))


def response(after_s: Array, bandwidth_radps: float, damping: float) -> Array:
    """Return the impulse response of the second-order loop, 1/s; 0 before the impulse."""
    w, z = bandwidth_radps, damping
    t = np.maximum(after_s, 0.0)
    root = np.sqrt(complex(z * z - 1.0))
    root = root if abs(root) > 1e-6 else 1e-6 + 0j
    shape = np.exp(-z * w * t) * (np.exp(w * root * t) - np.exp(-w * root * t)) / (2.0 * root)
    return np.where(after_s > 0.0, w * shape.real, 0.0)


def fit_attitude(seen: Observed) -> Fit:
    """Fit the delay from setpoint to the frame's arrival (s), natural frequency (rad/s) and damping ratio, (3,)."""
    grid_s = np.arange(seen.begin_s - _SETTLES_S, seen.end_s + _STEP_S, _STEP_S)
    commanded = smooth_held(grid_s, seen.sent_s, seen.sent_up_w[:, :2])
    shown = seen.quiet & (seen.came_s > seen.begin_s + _SETTLES_S)
    at_s, did = seen.came_s[shown], seen.up_w[shown, :2]
    size = 1 << (2 * len(grid_s)).bit_length()
    spectrum = np.fft.rfft(commanded - commanded[0], size, axis=0)

    def residuals(values: Array) -> Array:
        delay_s, bandwidth, damping = values
        kernel = response(np.arange(0.0, 3.0, _STEP_S), bandwidth, damping) * _STEP_S
        kernel /= kernel.sum()
        model = np.fft.irfft(spectrum * np.fft.rfft(kernel, size)[:, None], size, axis=0)[: len(grid_s)] + commanded[0]
        off = did - np.column_stack([np.interp(at_s - delay_s, grid_s, model[:, axis]) for axis in (0, 1)])
        return np.asarray((off - off.mean(axis=0)).T.ravel())

    block = np.tile(blocks(at_s, _BLOCK_S), 2)
    return fit(residuals, _FIRST, _STEPS, _BOUNDS, block, float(((did - did.mean(axis=0)) ** 2).mean()))
