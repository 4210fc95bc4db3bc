"""Motions as files describe them: complete only once it is known where the joints are that they leave out."""

from dataclasses import dataclass

import numpy as np

from companion.arms.inverse_kinematics import reach_both_rad
from companion.arms.model import SIDES, ArmModel
from companion.arms.trajectory import JointTrajectory, Sinusoid, Waypoints
from companion.core.interfaces import ArmError
from companion.core.types import Array


@dataclass(frozen=True)
class Poses:
    """Joint waypoints; NaN stays where it was."""

    times_s: Array
    """(n,), rising from 0."""
    joints_rad: Array
    """(n, 8)."""
    stop: bool

    def trajectory(self, model: ArmModel, present_rad: Array) -> JointTrajectory:  # noqa: ARG002
        """Return the motion through all of them; joints (8,) that are left out stay at `present_rad`."""
        poses = self.joints_rad.copy()
        last = present_rad
        for row, pose in enumerate(poses):
            last = poses[row] = np.where(np.isnan(pose), last, pose)
        return Waypoints(self.times_s, poses, self.stop)


@dataclass(frozen=True)
class Swing:
    """Sinusoids; a centre that is NaN is where the joint is."""

    centre_rad: Array
    amplitude_rad: Array
    period_s: Array
    phase_rad: Array
    duration_s: float
    fade_s: float

    def trajectory(self, model: ArmModel, present_rad: Array) -> JointTrajectory:  # noqa: ARG002
        """Return the swing; joints (8,) that are left out stay at `present_rad`."""
        centre_rad = np.where(np.isnan(self.centre_rad), present_rad, self.centre_rad)
        return Sinusoid(centre_rad, self.amplitude_rad, self.period_s, self.phase_rad, self.duration_s, self.fade_s)


@dataclass(frozen=True)
class Tips:
    """Positions that the tips are to reach, in body FLU; an arm of NaN stays where it was."""

    times_s: Array
    """(n,), rising from 0."""
    tips_flu_m: Array
    """(n, 2 arms, 3), m. Claws stay where they are."""
    stop: bool

    def trajectory(self, model: ArmModel, present_rad: Array) -> JointTrajectory:
        """Return joint angles that bring the tips there, each pose the nearest to the one before.

        Raises ArmError, naming the time, when a tip is out of reach. Between the points the joints move evenly, so the
        tips do not run along straight lines.
        """
        poses, last = [], present_rad
        for time_s, tips in zip(self.times_s.tolist(), self.tips_flu_m, strict=True):
            wanted = {side: tip for side, tip in zip(SIDES, tips, strict=True) if not np.isnan(tip).any()}
            try:
                last = reach_both_rad(model, wanted, last)
            except ArmError as error:
                raise ArmError(f"at t_s = {time_s:g}: {error}") from error
            poses.append(last)
        return Waypoints(self.times_s, np.stack(poses), self.stop)


Described = Poses | Swing | Tips
