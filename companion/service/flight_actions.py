"""Actions of the flight that an operator may command on a running service."""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any

from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import Autopilot, AutopilotError, CompanionError, FlightError, MocapError
from companion.core.types import Array, AutopilotStatus
from companion.flight.flight_loop import FlightLoop
from companion.preflight.checks.check import Check, refusal
from companion.protocol.check import Tell
from companion.service.arm_actions import ArmActions
from companion.service.trajectory_space import check_climb, check_room_and_fence
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import (
    INACTIVE,
    ArmRequest,
    FlightState,
    LandRequest,
    Leg,
    Phase,
    Request,
    TakeoffRequest,
    TrackRequest,
)
from companion.trajectories.reference import Hold, Trajectory, minimum_jerk_duration_s

LOG = logging.getLogger(__name__)

Preflight = Callable[[Tell], Awaitable[Sequence[Check]]]
"""Runs every preflight check."""
Params = Callable[[Sequence[str]], Awaitable[dict[str, float]]]
"""Reads the autopilot's parameters by name; those that it does not have are absent."""

_POLL_S = 0.02
_STREAM_FIRST_S = 0.2
"""Time setpoints are streamed before OFFBOARD is requested; MAVSDK stops its own stream after 3 s."""
_KNOWN_VELOCITY_MPS = 0.1
_LANDING_MARGIN_S = 20.0
_CLIMB_MARGIN_S = 15.0
_APPROACH_MARGIN_S = 15.0
"""Margin on top of the planned duration of the approach."""
_SAME_HEIGHT_M = 1e-6
_GOING = frozenset({Phase.HOLD, Phase.TRACK})
"""Phases on the way to a position."""


def _ignore(*_: object, **__: object) -> None:
    """Ignore a step of an action."""


@dataclass(frozen=True)
class DeviceReports:
    """Reports on the devices of a running service."""

    checks: Preflight
    params: Params
    warnings: tuple[str, ...] = ()
    """Remarks of the devices on their configuration, for the operator."""


def ended_by(flight: FlightState) -> str:
    """Return the reason why a motion ended, as part of a sentence; the flight itself may go on."""
    if flight.phase is Phase.HOLD and flight.level is FailsafeAction.WARN:
        return "ended by another command: a hold was ordered, the vehicle hovers"
    landing = flight.phase in {Phase.STOW, Phase.LAND}
    other = "a landing was ordered" if landing else f"it went to phase {flight.phase}"
    return f"the flight was ended: {flight.reason or other}"


class FlightActions:
    """Actions of an operator; each returns when it is done and raises CompanionError with the reason if not."""

    def __init__(
        self,
        loop: FlightLoop,
        autopilot: Autopilot,
        config: CompanionConfig,
        ticking: "asyncio.Task[None]",
        reports: DeviceReports,
    ) -> None:
        self.loop, self.reports = loop, reports
        self.ticking = ticking
        """Task of the flight loop; done when the loop has failed."""
        self._autopilot, self._config = autopilot, config
        self.arms = ArmActions(loop, config.arms, self.until, self.require_ground)
        """Actions of the arms."""

    @property
    def trouble(self) -> str:
        """Fault of this flight, also when it ended as it should; empty without one."""
        return self.loop.flight.reason or (self.loop.arms.fault if self.loop.arms is not None else "")

    @property
    def status(self) -> AutopilotStatus:
        """Newest status of the autopilot."""
        return self._autopilot.status()

    @property
    def phase(self) -> Phase:
        """Present phase of the flight."""
        return self.loop.flight.phase

    async def ready(self) -> None:
        """Wait until the vehicle's motion is estimated; raise MocapError when the body is not seen."""
        frames = self._config.law.onboard_mocap

        def known() -> bool:
            estimate = self.loop.estimate
            return estimate.velocity_std_mps < _KNOWN_VELOCITY_MPS if frames else estimate.vehicle is not None

        if not await self.until(known, self._config.mocap.first_frame_timeout_s):
            raise MocapError(self._why_unknown() if not frames else self._why_unseen())

    def _why_unseen(self) -> str:
        return (
            f"body {self._config.mocap.body!r} is not seen by motion capture (last frame: "
            f"{self.loop.estimate.verdict or 'none'}): is it in the volume, its markers uncovered?"
        )

    def _why_unknown(self) -> str:
        """Return which part of the estimate without frames is missing."""
        if math.isinf(self.status.velocity_s) or math.isinf(self.status.attitude_s):
            return (
                "the autopilot sends no attitude or no velocity (ATTITUDE_QUATERNION, LOCAL_POSITION_NED): is its "
                "link set up as onboard?"
            )
        return "no pose has come from the law on the ground: does `companion law` run there, and see the body?"

    async def _wait_for_status(self) -> None:
        """Wait until the autopilot has reported its arming state, its mode and whether it is in the air."""

        def known() -> bool:
            status = self._autopilot.status()
            return math.isfinite(status.heartbeat_s) and status.in_air is not None

        if not await self.until(known, self._config.px4.answer_timeout_s):
            silent = math.isinf(self._autopilot.status().heartbeat_s)
            what = "sends no HEARTBEAT" if silent else "does not say whether the vehicle stands or flies"
            raise AutopilotError(f"the autopilot was heard once but {what}: look at the link")

    async def require_ground(self) -> None:
        """Raise FlightError unless the autopilot reports the vehicle disarmed on the ground; wait for its report."""
        await self._wait_for_status()
        status = self._autopilot.status()
        if status.armed or status.in_air:
            raise FlightError(self._not_on_ground(bool(status.in_air)))

    def _not_on_ground(self, in_air: bool) -> str:
        """Return why an action for a disarmed vehicle on the ground is refused, and what to do."""
        where = "in the air" if in_air else "armed"
        if self.phase in INACTIVE:
            return (
                f"the vehicle is already {where}: this service does not take control of what it did not start; "
                "use the remote control"
            )
        if in_air:
            return "the vehicle is in the air, and this is for the ground: run `companion land` first"
        return "the vehicle is armed already: run `companion takeoff`, or `companion disarm` to stop the motors"

    async def arm(self, tell: Tell = _ignore) -> None:
        """Run every check, stream idle setpoints, switch to OFFBOARD, arm: the only order that works without GPS.

        `tell` gets what the checks wait for. FlightError names every check that fails. After any interruption, a
        command or a cancellation, the only request still sent to the autopilot is to disarm.
        """
        await self._check(tell)
        self._submit(ArmRequest())
        arm_requested = False
        try:
            await asyncio.sleep(_STREAM_FIRST_S)
            await self._while_preparing(self._autopilot.start_offboard)
            arm_requested = True
            await self._while_preparing(self._autopilot.arm)
            await self.until(lambda: self.phase is not Phase.PREFLIGHT, self._config.px4.answer_timeout_s)
            self._expect(Phase.ARMED)
        except BaseException:
            self.loop.submit(LandRequest())
            if arm_requested and self.phase is not Phase.LAND:  # in LAND the loop disarms by itself
                await self._disarm_again()
            raise

    async def _check(self, tell: Tell) -> None:
        """Run the checks before arming; raise FlightError when one fails or an abort or kill comes meanwhile."""
        arming, since_s = self.loop.arming, self.loop.flight.since_s

        def ended() -> bool:
            return bool(arming.called_off) or self.loop.flight.since_s != since_s

        with arming.checking():
            checking = asyncio.ensure_future(self._every_check(tell))
            await self._unless(ended, checking)
            if ended():
                reason = arming.called_off or self.loop.flight.reason
                raise FlightError(reason or f"the flight went to phase {self.phase} while the checks ran")
        checking.result()

    async def _every_check(self, tell: Tell) -> None:
        await self.require_ground()
        self.arms.check_ready()
        refused = refusal(await self.reports.checks(tell))
        if refused:
            raise FlightError(refused)

    async def _while_preparing(self, call: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Await a call that retries; cancel it when the preparation ends, as arming must not go on after a kill."""
        self._expect(Phase.PREFLIGHT)
        calling = asyncio.ensure_future(call())
        await self._unless(lambda: self.phase not in {Phase.PREFLIGHT, Phase.ARMED}, calling)
        if calling.cancelled():
            self._expect(Phase.ARMED)
        calling.result()

    async def _unless(self, ended: Callable[[], bool], doing: "asyncio.Future[None]") -> None:
        """Wait for a future and cancel it when `ended` becomes true first."""
        try:
            await self.until(lambda: doing.done() or ended(), math.inf)
        finally:
            doing.cancel()
            await asyncio.gather(doing, return_exceptions=True)

    async def _disarm_again(self) -> None:
        """Request disarming after an arming request that may not show in the status yet."""
        try:
            await self._autopilot.disarm()
        except CompanionError as error:
            LOG.error("not disarmed: %s", error)  # noqa: TRY400 - the sentence is for the operator

    async def take_off(self, height_m: float, accepted: Callable[[], None] = _ignore) -> None:
        """Climb to `height_m` above where the vehicle stands, and hold; `accepted` is called once it has started.

        Raises FlightError where the geofence is too near, and when another command held the vehicle at a lower height.
        """
        vehicle = self.loop.estimate.vehicle
        check_climb(height_m, None if vehicle is None else vehicle.position_w_m, self._config.fence)
        self._submit(TakeoffRequest(height_m))
        accepted()
        rules = self._config.flight_rules()
        climb_s = minimum_jerk_duration_s(height_m, rules.climb_speed_mps, rules.climb_accel_mps2)
        await self._reach(Phase.HOLD, climb_s + self._config.flight.spool_up_s + _CLIMB_MARGIN_S)
        held_m = self._held_at_m()
        if abs(held_m - height_m) > _SAME_HEIGHT_M:
            raise FlightError(f"{ended_by(self.loop.flight)} at {held_m:.2f} m, not at {height_m:g} m")

    def _held_at_m(self) -> float:
        """Return the height of the last hold point above where the vehicle stood, m."""
        flight = self.loop.flight
        ground_m = 0.0 if flight.ground_w_m is None else float(flight.ground_w_m[2])
        return float(flight.legs[-1].trajectory.at(0.0).position_w_m[2]) - ground_m

    async def go_to(self, position_w_m: Array, yaw_rad: float, accepted: Callable[[], None] = _ignore) -> None:
        """Fly straight to a position (3,) in W and a heading, and hold; `accepted` is called once it has started.

        Raises, before anything moves, ConfigError for a position outside the room and FlightError for one too near the
        geofence.
        """
        target = Hold(position_w_m, yaw_rad)
        await check_room_and_fence(target, self._config.room, self._config.fence)
        self._submit(TrackRequest(target, 0.0))
        accepted()
        approach, *_, end = self.loop.flight.legs
        timeout_s = approach.trajectory.duration_s + _APPROACH_MARGIN_S

        def over() -> bool:
            return self.loop.flight.legs == (end,) or self._diverted(end) or self.phase not in _GOING

        if not await self.until(over, timeout_s):
            raise FlightError(f"the position was not reached within {timeout_s:.0f} s")
        await asyncio.sleep(self._config.flight.settle_s)
        self._expect(Phase.HOLD, end)

    async def fly(self, trajectory: Trajectory, accepted: Callable[[], None] = _ignore) -> None:
        """Go to the trajectory's start, fly it, hold its end; `accepted` is called once it has started.

        Raises, before anything moves, ConfigError for a trajectory that leaves the room or is too fast and FlightError
        for one that comes too near the geofence; the vehicle then continues as before.
        """
        await check_room_and_fence(trajectory, self._config.room, self._config.fence)
        settle_s = self._config.flight.settle_s
        self._submit(TrackRequest(trajectory, settle_s))
        accepted()
        approach, *_, end = self.loop.flight.legs
        await self._reach(Phase.TRACK, approach.trajectory.duration_s + settle_s + _APPROACH_MARGIN_S, Phase.HOLD, end)
        await self._reach(Phase.HOLD, trajectory.duration_s + _CLIMB_MARGIN_S, end=end)
        await asyncio.sleep(settle_s)
        self._expect(Phase.HOLD, end)

    async def disarm(self) -> None:
        """Send a disarm request to the autopilot; raise AutopilotError when it refuses."""
        await self._autopilot.disarm()

    async def land(self, reason: str = "") -> None:
        """Land where the vehicle is, stop the motors and disarm, from any phase; on the ground only cancel an arming.

        `reason` is for the operator when no command asked for the landing. While the autopilot or its pilot has the
        vehicle, nothing is commanded and their landing is awaited; so is that of a failed flight loop, which has told
        the autopilot to land.
        """
        active = self.phase not in INACTIVE
        if self.phase is not Phase.HANDED_OVER:
            self.loop.submit(LandRequest(reason))
        if active:
            await self.wait_until_down()

    async def wait_until_down(self) -> None:
        """Wait until the vehicle is disarmed; raise FlightError when that takes too long or it is not heard."""
        vehicle = self.loop.estimate.vehicle
        height_m = abs(float(vehicle.position_w_m[2])) if vehicle else 0.0
        down_s = height_m / self._config.flight.descent_speed_mps

        def down() -> bool:
            status = self._autopilot.status()
            over = self.ticking.done() or self.phase in {Phase.DISARMED, Phase.TERMINATED}
            return not status.connected or (over and not status.armed)

        stow_s = self._config.arms.stow_time_s if self._config.arms else 0.0
        landed = await self.until(down, stow_s + down_s + _LANDING_MARGIN_S, although_failed=True)
        if not self._autopilot.status().connected:
            raise FlightError("the autopilot is not heard any more: check the vehicle and the link")
        if not landed:
            raise FlightError(
                f"the autopilot is still armed after landing: {self.loop.action_failure or f'phase {self.phase}'}"
            )

    def _submit(self, request: Request) -> None:
        rejection = self.loop.submit(request)
        if rejection:
            raise FlightError(rejection)

    def _diverted(self, end: Leg | None) -> bool:
        """Return whether another motion has replaced the one that ends with this leg."""
        legs = self.loop.flight.legs
        return end is not None and bool(legs) and legs[-1] is not end

    def _expect(self, phase: Phase, end: Leg | None = None) -> None:
        if self.phase is not phase or self.loop.flight.level > FailsafeAction.WARN or self._diverted(end):
            raise FlightError(ended_by(self.loop.flight))

    async def _reach(
        self, phase: Phase, timeout_s: float, through: Phase | None = None, end: Leg | None = None
    ) -> None:
        """Wait for a phase; raise FlightError when the flight goes elsewhere.

        It does so when it leaves the present phase and `through` for another one, or when the last leg is not `end`
        any more because another command replaced it.
        """
        on_the_way = {self.phase, through}

        def over() -> bool:
            return self.phase is phase or self.phase not in on_the_way or self._diverted(end)

        if not await self.until(over, timeout_s):
            raise FlightError(f"phase {phase} was not reached within {timeout_s:.0f} s, it is still {self.phase}")
        self._expect(phase, end)

    async def until(self, condition: Callable[[], bool], timeout_s: float, although_failed: bool = False) -> bool:
        """Poll a condition; return False after the timeout.

        Raises what stopped the flight loop, unless `although_failed`.
        """
        clock = asyncio.get_running_loop()
        end_s = clock.time() + timeout_s
        while not condition():
            if self.ticking.done() and not although_failed:
                self.ticking.result()
            if clock.time() > end_s:
                return False
            await asyncio.sleep(_POLL_S)
        return True
