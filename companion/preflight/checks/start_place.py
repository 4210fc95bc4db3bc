"""Checks that vehicle and trajectory stay inside the fence with its margin."""

import math

import numpy as np

from companion.core.types import Array
from companion.guard.geofence import Fence
from companion.preflight.checks.check import Check
from companion.trajectories.reference import Trajectory

_STEP_S = 0.02


def check_standing(position_w_m: Array | None, takeoff_height_m: float, fence: Fence, margin_m: float) -> Check:
    """Check that the vehicle's position, (3,) in W, and the hover above it are inside the fence."""
    if position_w_m is None:
        return Check("fence around the vehicle", False, "where it stands is not known", "see the mocap checks")
    above = position_w_m + np.array([0.0, 0.0, takeoff_height_m])
    inside_m = _inside_m(fence, above)
    x, y, z = (position_w_m.round(2) + 0.0).tolist()  # no -0.00
    says = f"stands at {x:.2f} {y:.2f} {z:.2f} m, hovers {inside_m:.2f} m inside, at least {margin_m:g} wanted"
    todo = "carry it further inside, or lower flight.takeoff_height_m"
    return Check("fence around the vehicle", inside_m >= margin_m, says, todo)


def check_trajectory(trajectory: Trajectory, fence: Fence, margin_m: float, times_s: Array | None = None) -> Check:
    """Check a trajectory's positions and stopping points with the margin: noise and errors must not reach the fence.

    Every 20 ms of it, or only at `times_s` (n,). What is no number is outside.
    """
    times_s = np.arange(0.0, trajectory.duration_s + _STEP_S, _STEP_S) if times_s is None else times_s
    references = [trajectory.at(float(time_s)) for time_s in times_s]
    inside_m = np.array([_inside_m(fence, reference.position_w_m) for reference in references])
    stopping_m = np.array(
        [
            _inside_m(fence, np.array(fence.stopping_point_w_m(reference.position_w_m, reference.velocity_w_mps)))
            for reference in references
        ]
    )
    least_m, stops_m = float(inside_m.min()), float(stopping_m.min())
    says = f"{least_m:.2f} m inside, and braking would end {stops_m:.2f} m inside, at least {margin_m:g} wanted"
    row = int(np.argmin(stopping_m if least_m >= margin_m else inside_m))
    todo = f"make it smaller, slower or move it: at {times_s[row]:.1f} s it comes too near"
    return Check("fence around the trajectory", least_m >= margin_m and stops_m >= margin_m, says, todo)


def _inside_m(fence: Fence, position_w_m: Array) -> float:
    return -fence.beyond_m(position_w_m) if np.isfinite(position_w_m).all() else math.nan
