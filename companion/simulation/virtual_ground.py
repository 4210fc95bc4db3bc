"""Law on the ground in a virtual flight: its cycle, the link, and the vehicle's hold between commands. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from companion.control.pipeline import ControlPipeline, PipelineOutput, changed
from companion.core.types import Array, AttitudeThrust, Mask, Reference, Scalar, VehicleState
from companion.geometry.array_math import where
from companion.geometry.attitude import ThrustModel, limit_tilt, setpoint_of_accel
from companion.guard.guard import SINKING, AgeRange
from companion.guard.limits import Limits, inside_cone, limit_setpoint
from companion.simulation.virtual_link import NONE, Numbers
from companion.simulation.virtual_link_ends import LinkEnds, LinkTiming, Messages
from mock_autopilot.impairment.sentences import Directions


@dataclass(frozen=True, kw_only=True)
class GroundRole:
    """Link between a law on the ground and its vehicles."""

    links: tuple[Directions, ...]
    """Impairments of the link, the same for all vehicles or one for each."""
    timing: LinkTiming = field(default_factory=LinkTiming)
    level: AgeRange = field(default_factory=lambda: AgeRange(0.12, 0.2))
    """Silences between which the vehicle is levelled."""


class GroundFlight:
    """Law on the ground, link, and the vehicles' hold; one vehicle, or a batch of shape `lead`.

    As in `companion.ground`, the law computes as if it stood on the vehicle when its command arrives. The setpoint sent
    last is the ground's own copy of what the limits make of its commands, corrected by reports.
    """

    def __init__(
        self,
        pipeline: ControlPipeline,
        vehicle: "HeldCommand",
        role: GroundRole,
        seeds: Sequence[int],
        cycles: int,
        period_s: float,
    ) -> None:
        links = role.links if len(role.links) == len(seeds) else role.links * len(seeds)
        self._ends = LinkEnds(links, role.timing, seeds, cycles, period_s)
        self._pipeline, self._vehicle, self._period_s = pipeline, vehicle, period_s
        self._up_age_s, self._level, self._mirror = role.timing.up_age_s, role.level, vehicle.held
        self._accel_w_mps2, self._yaw_rad = np.zeros((cycles, len(seeds), 3)), np.zeros((cycles, len(seeds)))
        """Command of each cycle."""
        self._sent_q, self._sent_thrust = np.zeros((cycles, len(seeds), 4)), np.zeros((cycles, len(seeds)))
        """Setpoint of the vehicles in each cycle, as reported to the ground."""
        self._each = np.arange(len(seeds))

    def fly(
        self,
        cycle: int,
        seen: VehicleState,
        age_s: Scalar,
        ahead: Reference,
        last: AttitudeThrust,
        known_accel_w_mps2: Array,
    ) -> tuple[PipelineOutput, AttitudeThrust]:
        """Run a cycle on both sides; return the law's output and the vehicle's setpoint, which follows `last`.

        `ahead` and `known_accel_w_mps2` are those of the command's arrival.
        """
        self._ends.hear_reports(cycle)
        self._correct_mirror()
        age_s = age_s + self._up_age_s
        output = self._pipeline.fly(seen, age_s, ahead, self._mirror, self._period_s, known_accel_w_mps2)
        self._mirror = output.limited.setpoint
        law = output.law_output
        self._accel_w_mps2[cycle], self._yaw_rad[cycle] = law.accel_w_mps2, law.heading_rad(ahead)
        self._ends.send(cycle, np.atleast_1d(output.is_new))
        silence_s = self._ends.hear_commands(cycle)
        self._vehicle.take(self._ends.in_use, self._accel_w_mps2, self._yaw_rad)
        setpoint = self._vehicle.setpoint(silence_s, last, self._period_s)
        self._sent_q[cycle], self._sent_thrust[cycle] = setpoint.q_w_flu_wxyz, setpoint.thrust
        self._ends.report(cycle, np.atleast_1d(changed(setpoint, last)), silence_s > self._level.coast_s)
        return output, setpoint

    def _correct_mirror(self) -> None:
        """Take over what a vehicle has reported, where it is not what its command says."""
        wrong = self._ends.is_cut
        if not wrong.any():
            return
        row, mirror = np.maximum(self._ends.reported, 0), self._mirror
        q = np.where(wrong[:, None], self._sent_q[row, self._each], mirror.q_w_flu_wxyz)
        thrust = np.where(wrong, self._sent_thrust[row, self._each], mirror.thrust)
        self._mirror = AttitudeThrust(q.reshape(mirror.q_w_flu_wxyz.shape), thrust.reshape(mirror.thrust.shape))

    def settle(self) -> dict[str, Array]:
        """Run the second half of the law's cycle."""
        return self._pipeline.settle()

    def messages(self) -> Messages:
        """Return the messages of the whole flight."""
        return self._ends.messages(self._vehicle.held.thrust.shape)


class HeldCommand:
    """Vehicles' side: the newest command that has arrived, held as a setpoint, and levelled after a silence."""

    def __init__(self, first: AttitudeThrust, thrust: ThrustModel, limits: Limits, level: AgeRange) -> None:
        self.held = first
        """Setpoint of the newest command."""
        self._thrust, self._limits, self._level = thrust, limits, level
        self._number = np.full(max(1, first.thrust.size), NONE)

    def take(self, number: Numbers, accel_w_mps2: Array, yaw_rad: Array) -> None:
        """Hold the commands of these numbers (B,) out of all, (cycles, B, 3) and (cycles, B), where they are new."""
        is_new = number > self._number
        if not is_new.any():
            return
        rows, each = np.maximum(number, 0), np.arange(len(number))
        accel, yaw = accel_w_mps2[rows, each], yaw_rad[rows, each]
        self._number = np.maximum(number, self._number)
        self.held = self._converted(accel, yaw, is_new) if self.held.thrust.ndim else self._one(accel, yaw)

    def _one(self, accel_w_mps2: Array, yaw_rad: Array) -> AttitudeThrust:
        return self._setpoint(accel_w_mps2[0], float(yaw_rad[0]))

    def _converted(self, accel_w_mps2: Array, yaw_rad: Array, is_new: Mask) -> AttitudeThrust:
        new = self._setpoint(accel_w_mps2, yaw_rad)
        q = where(is_new[:, None], new.q_w_flu_wxyz, self.held.q_w_flu_wxyz)
        return AttitudeThrust(q, np.where(is_new, new.thrust, self.held.thrust))

    def _setpoint(self, accel_w_mps2: Array, yaw_rad: Scalar) -> AttitudeThrust:
        upright = limit_tilt(accel_w_mps2, self._limits.max_tilt_rad, self._thrust.gravity_mps2)
        return setpoint_of_accel(upright, yaw_rad, self._thrust)

    def setpoint(self, silence_s: Array, last: AttitudeThrust, dt_s: float) -> AttitudeThrust:
        """Return the setpoint `dt_s` after `last`, the ground's newest message being `silence_s` (B,) old."""
        wanted = self.held
        if (silence_s > self._level.coast_s).any():
            wanted = self._levelled(wanted, silence_s)
        return limit_setpoint(wanted, last, self._limits, dt_s).setpoint

    def _levelled(self, wanted: AttitudeThrust, silence_s: Array) -> AttitudeThrust:
        """Blend to level and sinking gently, as the guard does."""
        q, thrust = np.atleast_2d(wanted.q_w_flu_wxyz).copy(), np.atleast_1d(wanted.thrust).copy()
        sinking = SINKING * self._thrust.hover_thrust
        for vehicle in np.flatnonzero(silence_s > self._level.coast_s):
            known = self._level.share(float(silence_s[vehicle]))
            q[vehicle], _ = inside_cone(q[vehicle], known * self._limits.max_tilt_rad)
            thrust[vehicle] = known * thrust[vehicle] + (1.0 - known) * sinking
        return AttitudeThrust(q.reshape(wanted.q_w_flu_wxyz.shape), thrust.reshape(wanted.thrust.shape))
