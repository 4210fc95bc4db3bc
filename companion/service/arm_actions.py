"""Actions of the arms that an operator may command."""

from collections.abc import Awaitable, Callable

from companion.arms.state_machine import ArmPhase
from companion.arms.trajectory import JointTrajectory
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import FlightError
from companion.core.types import Array
from companion.flight.arm_step import ArmStep
from companion.flight.flight_loop import FlightLoop

_SETTLE_S = 2.0
"""Time allowed for a joint to report its torque, or to come to rest at the end of a motion."""

WaitUntil = Callable[[Callable[[], bool], float], Awaitable[bool]]
"""Waits until a condition holds; returns False after a timeout in seconds."""
RequireGround = Callable[[], Awaitable[None]]
"""Raises FlightError unless the vehicle is known to be disarmed and on the ground."""


class ArmActions:
    """Commands to the arms of a running service; each raises FlightError for a vehicle without arms."""

    def __init__(
        self, loop: FlightLoop, config: ArmsConfig | None, wait_until: WaitUntil, require_ground: RequireGround
    ) -> None:
        self._loop, self._config, self._wait_until, self._require_ground = loop, config, wait_until, require_ground

    def check_ready(self) -> None:
        """Raise FlightError unless the arms are held stowed: hanging arms hit the floor, limp ones swing."""
        arms = self._loop.arms
        if arms is None:
            return
        if arms.fault:
            raise FlightError(arms.fault)
        if arms.state.phase is not ArmPhase.HOLDING:
            raise FlightError(f"the arms are {arms.state.phase}; run `companion arms live ready` first")
        if arms.off_stow:
            raise FlightError(f"{arms.off_stow}; stow the arms first")

    async def prepare(self) -> Array:
        """Enable torque without a jump and fold the arms, on the ground; return the held joint angles (8,), rad.

        Raises ArmError when a joint refuses or no collision-free path to the stowed pose exists, FlightError when the
        arms do not reach it or the vehicle is not on the ground (in the air the flight does not know this motion).
        """
        arms, config = self._require_arms()
        await self._require_ground()
        await arms.torque_on()
        held_rad = await self._held(arms, _SETTLE_S)
        fold = arms.way_to_stow(held_rad, config.floor_z_m) if arms.off_stow else None
        if fold is not None:
            self.begin(fold)
            held_rad = await self._held(arms, fold.duration_s + _SETTLE_S)
        if not await self._wait_until(lambda: not arms.off_stow, _SETTLE_S):
            raise FlightError(f"the arms do not reach their stowed pose: {arms.off_stow}")
        return held_rad

    def begin(self, motion: JointTrajectory) -> None:
        """Start a motion planned from the held joint angles; raise ArmError with the reason when it may not start."""
        arms, _ = self._require_arms()
        arms.play(motion, self._loop.flight.phase)

    @property
    def held_rad(self) -> Array:
        """Joint angles (8,) that are held now, rad; FlightError while the arms move or do not hold."""
        arms, _ = self._require_arms()
        if arms.held_rad is None:
            raise FlightError(f"the arms must hold still first, they are {arms.fault or arms.state.phase}")
        return arms.held_rad

    def still(self, reason: str) -> None:
        """Stop the running motion along its path; do nothing when the arms hold already."""
        arms, _ = self._require_arms()
        arms.stop(reason)

    def end(self, motion: JointTrajectory, reason: str) -> None:
        """Stop this motion along its path; do nothing when it no longer runs."""
        arms, _ = self._require_arms()
        if arms.state.motion is motion:
            arms.stop(reason)

    async def at_rest(self, within_s: float) -> None:
        """Wait until a motion of duration `within_s` is over; raise FlightError when something else ended it."""
        arms, _ = self._require_arms()
        motion = arms.state.motion
        if not await self._wait_until(lambda: arms.state.motion is not motion, within_s + _SETTLE_S):
            raise FlightError(f"the arms still move after {within_s + _SETTLE_S:.0f} s")
        if arms.fault or (arms.state.motion is not None) or arms.state.reason:
            raise FlightError(f"the motion was ended: {arms.fault or arms.state.reason or arms.state.phase}")

    async def fold(self, accepted: Callable[[str], None]) -> None:
        """Fold the held arms, in flight or on the ground; raise FlightError when they do not get there."""
        arms, config = self._require_arms()
        floor_z_m = None if self._loop.flight.airborne else config.floor_z_m
        fold_motion = arms.way_to_stow(self.held_rad, floor_z_m)
        if fold_motion is None:
            accepted("the arms are folded")
            return
        self.begin(fold_motion)
        accepted(f"the arms fold, {fold_motion.duration_s:.0f} s")
        await self.at_rest(fold_motion.duration_s)

    async def limp(self) -> None:
        """Disable torque on the ground; raise ArmError naming the joints that do not answer."""
        arms, _ = self._require_arms()
        await self._require_ground()
        await arms.torque_off()

    async def clear_faults(self) -> None:
        """Clear the arms' latched faults; raise ArmError naming those that persist. Call `prepare` afterwards."""
        arms, _ = self._require_arms()
        await arms.clear_faults()

    def _require_arms(self) -> tuple[ArmStep, ArmsConfig]:
        if self._loop.arms is None or self._config is None:
            raise FlightError("this vehicle has no arms: its configuration has no [arms]")
        return self._loop.arms, self._config

    async def _held(self, arms: ArmStep, timeout_s: float) -> Array:
        """Wait until the arms stand still and return the held joint angles (8,), rad."""
        await self._wait_until(lambda: arms.held_rad is not None or bool(arms.fault), timeout_s)
        if arms.held_rad is None or arms.fault:
            raise FlightError(f"the arms are {arms.state.phase} and should be holding: {arms.fault or 'time is up'}")
        return arms.held_rad
