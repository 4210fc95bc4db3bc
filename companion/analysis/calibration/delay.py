"""The delay of motion capture, against the autopilot's own attitude."""

import numpy as np

from companion.analysis.calibration.fitting import Fit, fit
from companion.analysis.calibration.signals import Observed, blocks
from companion.core.types import Array

_BLOCK_S = 3.0


def fit_mocap_delay(seen: Observed) -> Fit:
    """(1,): from a capture to its arrival, less the time that the autopilot's attitude is on its way, s.

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
