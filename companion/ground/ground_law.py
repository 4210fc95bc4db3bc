"""One cycle of the law on the ground. No I/O, no clock.

The law computes as if it stood on the vehicle when its command arrives: the state is older by the uplink's age, the
reference and the arms' motion are those of that moment, and the setpoint sent last is the ground's own copy of what the
vehicle makes of its commands, corrected by reports where the vehicle did otherwise.
"""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.arms.feedforward import ArmFeedforward
from companion.control.controller import Controller
from companion.control.pipeline import ControlPipeline, PipelineOutput
from companion.core.types import Array, AttitudeThrust, JointMotion, MocapFrame, Reference, VehicleState
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState, Verdict
from companion.geometry.frames import matrix_from_quat, yaw_of
from companion.ground.ground_tick import FlownCycle, GroundTick
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import NO_FLAGS, Command, DownFlags, Plan, Pose, Report, UpFlags, short_ticks
from companion.law_link.plan import PlannedMotion
from companion.supervisor.flight_state import INACTIVE, PHASES

LOG = logging.getLogger(__name__)

_JUMPED = "motion capture's pose jumped in flight, or came back elsewhere after a gap"
_BEYOND_PLAN_S = 0.3
_BAD_CYCLES = 20
_RETUNE_S = 0.004
"""Change of the uplink's age for which the law is made anew, on the ground only."""
_LONGEST_UP_S = 0.1
_OVER = frozenset(number for number, phase in enumerate(PHASES) if phase in INACTIVE)
"""Numbers of the phases before and after a flight in a report."""


@dataclass(frozen=True, kw_only=True)
class GroundParts:
    """Parts of the law on the ground, from the configuration."""

    pipeline: Callable[[Controller], ControlPipeline]
    estimator: EstimatorParams
    feedforward: ArmFeedforward | None
    period_s: float
    delay_s: float
    """Usual age of the uplink, until it is measured."""
    oldest_s: float
    """Age of the state above which the law is blind: a law on board is not limited up to the same age."""
    with_pose: bool
    """Each message carries the pose, as no frames reach the vehicle."""


class GroundLaw:
    """Holds estimator, law and their memories; call `take` for each frame and `tick` once a cycle."""

    def __init__(self, end: GroundEnd, parts: GroundParts, name: str, law: Controller) -> None:
        """Take a law that was made for an uplink of the usual age, `parts.delay_s`."""
        self._end, self._parts = end, parts
        self._estimate = EstimatorState()
        self.made_for_s = parts.delay_s
        """Age of the uplink for which the law was made, s."""
        self.name = name
        self._pipeline = parts.pipeline(law)
        self._flying, self._epoch = False, 0
        self._mirror: AttitudeThrust | None = None
        self._report: Report | None = None
        self._plan: Plan | None = None
        self._motion: PlannedMotion | None = None
        self._due = False
        """A command is new and was not sent yet."""
        self._bad = 0
        self._failure = ""
        self._doubted = False
        """The pose has jumped in this flight."""

    @property
    def failure(self) -> str:
        """Reason for which the law is no longer trusted; empty while it is."""
        return _JUMPED if self._doubted else self._failure

    @property
    def estimate(self) -> EstimatorState:
        """Newest estimate of the vehicle's motion."""
        return self._estimate

    def take(self, frame: MocapFrame) -> None:
        """Feed a frame to the estimator."""
        self._estimate = estimator.step(self._estimate, frame, self._parts.estimator)
        if self._flying and self._parts.with_pose and self._estimate.verdict is Verdict.STARTED:
            self._doubt()

    def _doubt(self) -> None:
        """End the flight, and send no pose until it is over: the vehicle, without frames, cannot see a jump itself."""
        if not self._doubted:
            self._doubted = True
            LOG.error(_JUMPED)

    def switch(self, name: str, law: Controller) -> None:
        """Fly another law from the next cycle on, without a jump of the command."""
        LOG.info("control law %s -> %s", self.name, name)
        self._pipeline.switch(law)
        self.name, self._end.law = name, (self._end.law + 1) % 16
        self._failure, self._bad = "", 0

    def tick(self, now_s: float, dt_s: float) -> GroundTick:
        """Run one cycle, and hand its command to the link."""
        self._hear()
        age_s = estimator.age_s(self._estimate, now_s)
        flown = None
        arrives_s = now_s + self._end.clock.offset_s + self._up_age_s()
        if self._flying:
            flown = self._fly(now_s, arrives_s, age_s, dt_s)
        else:
            self._end.flags = UpFlags.BLIND if self._is_blind(age_s) else NO_FLAGS
            self._end.flags |= UpFlags.FAILED if self.failure else NO_FLAGS
        self._end.pose = self._pose(age_s) if self._parts.with_pose else None
        return GroundTick(
            time_s=now_s,
            vehicle_s=arrives_s,
            estimate=self._estimate,
            age_s=age_s,
            flown=flown,
            flags=self._end.flags,
            law=self.name,
            made_for_s=self.made_for_s,
            failure=self.failure,
            flying=self._flying,
            epoch=self._epoch,
            link=self._end.state(now_s),
        )

    def settle(self) -> dict[str, Array]:
        """Do what the law left for after the command, and return its late internal values."""
        if not self._flying or self.failure:
            return {}
        try:
            return self._pipeline.settle()
        except Exception as error:
            self._fail(error)
            return {}

    def _hear(self) -> None:
        """Take the newest report and plan; begin or end a flight."""
        report, plan = self._end.report, self._end.plan
        if plan is not None and plan is not self._plan:
            self._plan, self._motion = plan, PlannedMotion(plan)
        if report is None or report is self._report:
            return
        self._report = report
        airborne = bool(report.flags & DownFlags.AIRBORNE)
        if self._doubted and report.phase in _OVER:
            self._doubted = False
        if airborne and (not self._flying or report.epoch != self._epoch):
            self._begin(report)
        elif not airborne and self._flying:
            self._flying = False
            self._pipeline.forget()

    def _begin(self, report: Report) -> None:
        self._pipeline.forget()
        self._flying, self._epoch, self._end.epoch = True, report.epoch, report.epoch
        self._mirror, self._due = _setpoint_of(report), False
        self._failure, self._bad = "", 0
        if self._parts.feedforward is not None:
            self._parts.feedforward.reset()

    def _up_age_s(self) -> float:
        measured_s = self._end.up_age_s
        return min(measured_s, _LONGEST_UP_S) if math.isfinite(measured_s) else self._parts.delay_s

    @property
    def wants_law_for_s(self) -> float | None:
        """Age of the uplink (s) that the law should be made for anew, as it has changed; None in flight."""
        report, age_s = self._report, self._up_age_s()
        busy = report is None or self._flying or bool(report.flags & DownFlags.ARMING)
        return None if busy or abs(age_s - self.made_for_s) <= _RETUNE_S else age_s

    def adopt(self, law: Controller, age_s: float) -> None:
        """Use a law that was made for this age of the uplink (s), unless a flight has begun meanwhile."""
        if not self._flying:
            LOG.info("commands are %.0f ms old when they are used: the law is made for that", 1e3 * age_s)
            self._pipeline, self.made_for_s, self._failure = self._parts.pipeline(law), age_s, ""

    def reject(self, reason: str, age_s: float) -> None:
        """Begin no flight with an uplink of this age (s): the vehicle is told that the law has failed.

        A flight that has begun meanwhile goes on with the law that it began with.
        """
        if self._flying:
            LOG.warning("%s; the flight goes on with the law for %.0f ms", reason, 1e3 * self.made_for_s)
            return
        LOG.error(reason)
        self._failure, self.made_for_s = reason, age_s

    def _is_blind(self, age_s: float) -> bool:
        return self._estimate.vehicle is None or not age_s <= self._parts.oldest_s

    def _is_planned(self, vehicle_s: float) -> bool:
        """Return True if the plan reaches to this time of the vehicle, which is NaN while its clock is unknown."""
        motion = self._motion
        if motion is None or not math.isfinite(vehicle_s):
            return False
        return motion.since_begin_s(vehicle_s) <= motion.length_s + _BEYOND_PLAN_S

    def _fly(self, now_s: float, arrives_s: float, age_s: float, dt_s: float) -> FlownCycle | None:
        vehicle, motion = self._estimate.vehicle, self._motion
        blind = self._is_blind(age_s) or not self._is_planned(arrives_s)
        self._end.flags = UpFlags.FLYING | (UpFlags.BLIND if blind else NO_FLAGS)
        if self.failure:
            self._end.flags |= UpFlags.FAILED
        if blind or self.failure or vehicle is None or motion is None or self._mirror is None:
            return None
        self._correct_mirror()
        mirror = self._mirror
        ahead = motion.reference(arrives_s + self._pipeline.preview_s)
        known = self._known_accel(motion, arrives_s, vehicle)
        try:
            output = self._pipeline.fly(vehicle, age_s + self._up_age_s(), ahead, mirror, dt_s, known)
        except Exception as error:
            self._fail(error)
            return None
        self._mirror = output.limited.setpoint
        sent = self._sent(output, ahead, now_s, vehicle)
        here = motion.reference(now_s + self._end.clock.offset_s)
        return FlownCycle(output=output, sent=sent, mirror=mirror, reference=here)

    def _correct_mirror(self) -> None:
        """Take over what the vehicle has sent while its guard changes our commands.

        Not for a lost command, which is sent again at once: the report would tell the predictor an old setpoint as the
        newest, and that is worse than nothing (measured: 5 to 27 % more events at 30 % loss, no smaller error).
        """
        if self._report is not None and self._report.flags & DownFlags.CUT:
            self._mirror = _setpoint_of(self._report)

    def _known_accel(self, motion: PlannedMotion, arrives_s: float, vehicle: VehicleState) -> Array:
        feedforward = self._parts.feedforward
        if feedforward is None or motion.joints(arrives_s) is None:
            return np.zeros(3)

        def joints_at(time_s: float) -> JointMotion:
            joints = motion.joints(time_s)
            assert joints is not None, "a plan has joints in all of its knots or in none"
            return joints

        return np.asarray(matrix_from_quat(vehicle.q_w_flu_wxyz) @ feedforward.step(joints_at, arrives_s))

    def _sent(self, output: PipelineOutput, ahead: Reference, now_s: float, vehicle: VehicleState) -> Command | None:
        """Hand the cycle's command to the link if it is to be sent: at an event, or where the heading has turned."""
        accel = output.law_output.accel_w_mps2
        self._due |= bool(output.is_new)
        if not np.isfinite(accel).all():
            self._bad += 1
            if self._bad > _BAD_CYCLES:
                self._failure = f"the control law gave no finite command for {_BAD_CYCLES} cycles"
                LOG.error(self._failure)
            return None
        self._bad = 0
        if not self._due:
            return None
        self._due = False
        x, y, z = accel.tolist()
        yaw_rad, ago = float(output.law_output.heading_rad(ahead)), short_ticks(now_s - vehicle.time_s)
        command = Command(accel_w_mps2=(x, y, z), yaw_rad=yaw_rad, capture_ago=ago)
        self._end.command(command)
        return command

    def _fail(self, error: Exception) -> None:
        LOG.exception("the control law failed")
        self._failure = f"the control law failed: {type(error).__name__}: {error}"
        self._end.flags |= UpFlags.FAILED

    def _pose(self, age_s: float) -> Pose | None:
        """Return the pose of now, carried forward with the velocity."""
        vehicle = self._estimate.vehicle
        if vehicle is None or self._is_blind(age_s) or self._doubted:
            return None
        x, y, z = (vehicle.position_w_m + age_s * vehicle.velocity_w_mps).tolist()
        return Pose(position_w_m=(x, y, z), yaw_rad=float(yaw_of(vehicle.q_w_flu_wxyz)))


def _setpoint_of(report: Report) -> AttitudeThrust:
    return AttitudeThrust(np.array(report.q_w_flu_wxyz), np.array(report.thrust))
