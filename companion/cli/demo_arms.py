"""What the arms do during a demo."""

from companion.arm_files import motion_named
from companion.arms.planning import Plan, plan
from companion.config import CompanionConfig
from companion.control.reference import Trajectory
from companion.ports import ConfigError

_AROUND_S = 30.0
"""The way to the trajectory's start and the pauses: the arms swing on until they are stowed for the landing."""


def plan_arms(name: str, config: CompanionConfig, trajectory: Trajectory) -> Plan | None:
    """A motion for the whole flight, from the stowed pose; None for `off`. Raises ArmError or ConfigError."""
    if config.arms is None:
        if name not in {"off", "swing"}:
            raise ConfigError(f"--arms {name}: this vehicle has no arms, its configuration has no [arms]")
        return None
    if name == "off":
        return None
    model, stowed_rad = config.arms.model(), config.arms.stow_rad()
    motion = motion_named(name, trajectory.duration_s + _AROUND_S).trajectory(model, stowed_rad)
    return plan(model, motion, stowed_rad, via_rad=(config.arms.home_rad(),))
