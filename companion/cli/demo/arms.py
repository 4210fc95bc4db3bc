"""Arm motion of a demo flight."""

from companion.arms.planning import Plan, plan
from companion.config.arm_files import motion_named
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.trajectories.reference import Trajectory

_AROUND_S = 30.0
"""Time beside the trajectory: the arms keep moving until they are stowed for the landing."""


def plan_arms(
    name: str, config: CompanionConfig, trajectory: Trajectory, start_rad: Array | None = None
) -> Plan | None:
    """Plan a motion for the whole flight, from `start_rad` (8,) or the stowed pose; None for `off`.

    Raises ArmError or ConfigError with the reason when it cannot be run.
    """
    if config.arms is None:
        if name not in {"off", "swing"}:
            raise ConfigError(f"--arms {name}: this vehicle has no arms, its configuration has no [arms]")
        return None
    if name == "off":
        return None
    model, start = config.arms.model(), config.arms.stow_rad() if start_rad is None else start_rad
    motion = motion_named(name, trajectory.duration_s + _AROUND_S).trajectory(model, start)
    return plan(model, motion, start, via_rad=(config.arms.home_rad(),))
