"""The operator's verbs of a running service."""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import Autopilot, AutopilotError, CompanionError, FlightError, MocapError
from companion.core.types import Array, AutopilotStatus
from companion.flight.flight_loop import FlightLoop
from companion.preflight.checks.check import Check, refusal
from companion.service.arm_actions import ArmActions
from companion.service.trajectory_space import check_climb, check_room, check_room_and_fence
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import (
    ArmRequest,
    FlightState,
    HoldRequest,
    KillRequest,
    LandRequest,
    Leg,
    Phase,
    Request,
    ResumeRequest,
    TakeoffRequest,
    TrackRequest,
)
from companion.trajectories.reference import Hold, Trajectory, minimum_jerk_duration_s

LOG = logging.getLogger(__name__)

Preflight = Callable[[Trajectory | None], Awaitable[Sequence[Check]]]
"""Every check of a vehicle that is to fly this."""
Params = Callable[[Sequence[str]], Awaitable[dict[str, float]]]
"""Values of the autopilot's parameters by name; those that it does not know are absent."""

_POLL_S = 0.02
_STREAM_FIRST_S = 0.2
"""Setpoints stream so long before OFFBOARD is asked for; MAVSDK gives up its own stream after 3 s."""
_KNOWN_VELOCITY_MPS = 0.1
_LANDING_MARGIN_S = 20.0
_CLIMB_MARGIN_S = 15.0
_APPROACH_MARGIN_S = 15.0
"""Beyond what the way to a place takes."""
_SAME_HEIGHT_M = 1e-6
_OURS = frozenset(Phase) - {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED}
"""Phases of a flight that this service has begun."""


async def _no_params(_: Sequence[str]) -> dict[str, float]:
    """Of an autopilot that has none."""
    return {}


def _nothing() -> None:
    """Nobody wants to know."""


def _tell_nobody(_: str) -> None:
    """Nobody wants to know."""


def ended_by(flight: FlightState) -> str:
    """Return what ended a motion, for a sentence: the flight itself may go on."""
    if flight.phase is Phase.HOLD and flight.level is FailsafeAction.WARN:
        return "ended by another command: a hold was ordered, the vehicle hovers"
    if flight.phase in {Phase.STOW, Phase.LAND}:
        return f"the flight was ended: {flight.reason or 'a landing was ordered'}"
    if flight.phase in {Phase.DISARMED, Phase.TERMINATED}:
        return f"the flight was ended: {flight.reason or f'the vehicle is down, phase {flight.phase}'}"
    return f"the flight was ended: {flight.reason or f'it went to phase {flight.phase}'}"


class FlightActions:
    """The verbs of an operator; each returns when it is done and raises CompanionError with the reason if not."""

    def __init__(
        self,
        loop: FlightLoop,
        autopilot: Autopilot,
        config: CompanionConfig,
        ticking: "asyncio.Task[None]",
        checks: Preflight,
        params: Params = _no_params,
    ) -> None:
        self.loop = loop
        self.warnings: tuple[str, ...] = ()
        """What a device would like to have otherwise, for the operator to read."""
        self._autopilot, self._config, self._ticking = autopilot, config, ticking
        self.checks, self.params = checks, params
        self.tell_waiting: Callable[[str], None] = _tell_nobody
        """Told what the checks wait for; see waits_told_to."""
        self.arms = ArmActions(loop, config.arms, self.until, self.require_ground)
        """What an operator may ask of the arms."""

    @contextmanager
    def waits_told_to(self, tell: Callable[[str], None]) -> Iterator[None]:
        """Have `tell` called with what is waited for meanwhile."""
        self.tell_waiting = tell
        try:
            yield
        finally:
            self.tell_waiting = _tell_nobody

    @property
    def trouble(self) -> str:
        """What went wrong in this flight, although it may have ended as it should; empty when nothing did."""
        return self.loop.flight.reason or (self.loop.arms.fault if self.loop.arms is not None else "")

    @property
    def status(self) -> AutopilotStatus:
        """What the autopilot last said."""
        return self._autopilot.status()

    @property
    def ticking(self) -> "asyncio.Task[None]":
        """The flight loop: done when it has failed."""
        return self._ticking

    @property
    def phase(self) -> Phase:
        """Where in a flight we are."""
        return self.loop.flight.phase

    async def ready(self) -> None:
        """Wait until the vehicle's motion is known; MocapError when the body is not seen."""

        def known() -> bool:
            return self.loop.estimate.velocity_std_mps < _KNOWN_VELOCITY_MPS

        if not await self.until(known, self._config.mocap.first_frame_timeout_s):
            raise MocapError(
                f"body {self._config.mocap.body!r} is not seen by motion capture (last frame: "
                f"{self.loop.estimate.verdict or 'none'}): is it in the volume, its markers uncovered?"
            )

    async def _heard(self) -> None:
        """Wait until the autopilot has said whether it is armed, in which mode, and whether it stands."""

        def known() -> bool:
            status = self._autopilot.status()
            return math.isfinite(status.heartbeat_s) and status.in_air is not None

        if not await self.until(known, self._config.px4.answer_timeout_s):
            silent = math.isinf(self._autopilot.status().heartbeat_s)
            what = "sends no HEARTBEAT" if silent else "does not say whether the vehicle stands or flies"
            raise AutopilotError(f"the autopilot was heard once but {what}: look at the link")

    async def require_ground(self) -> None:
        """FlightError unless the autopilot says that the vehicle stands, disarmed; waits until it has said so."""
        await self._heard()
        status = self._autopilot.status()
        if status.armed or status.in_air:
            raise FlightError(self._not_on_ground(bool(status.in_air)))

    def _not_on_ground(self, in_air: bool) -> str:
        """Return what keeps an armed vehicle from being armed or its arms from being touched, and what to do."""
        where = "in the air" if in_air else "armed"
        if self.phase not in _OURS:
            return (
                f"the vehicle is already {where}: this service does not take control of what it did not start; "
                "use the remote control"
            )
        if in_air:
            return "the vehicle is in the air, and this is for the ground: run `companion land` first"
        return "the vehicle is armed already: run `companion takeoff`, or `companion disarm` to stop the motors"

    async def arm(self, trajectory: Trajectory | None = None) -> None:
        """Check everything, stream idle setpoints, switch to OFFBOARD, arm: the only order that works without GPS.

        `trajectory` is what will be flown, if it is known. FlightError names every check that fails, ConfigError says
        where it leads out of the room. Whatever interrupts it, an operator's order or cancellation too, nothing is
        asked of the autopilot any more but to disarm.
        """
        await self._check(trajectory)
        self._ask(ArmRequest(), "arm")
        asked = False
        try:
            await asyncio.sleep(_STREAM_FIRST_S)
            await self._while_preparing(self._autopilot.start_offboard)
            asked = True
            await self._while_preparing(self._autopilot.arm)
            await self.until(lambda: self.phase is not Phase.PREFLIGHT, self._config.px4.answer_timeout_s)
            self._expect(Phase.ARMED)
        except BaseException:
            self.loop.ask(LandRequest())
            if asked and self.phase is not Phase.LAND:  # in LAND the loop disarms by itself
                await self._disarm_again()
            raise

    async def _check(self, trajectory: Trajectory | None) -> None:
        """All that is looked at before arming; FlightError, too, when an abort or a kill comes meanwhile."""
        arming, since_s = self.loop.arming, self.loop.flight.since_s

        def ended() -> bool:
            return bool(arming.called_off) or self.loop.flight.since_s != since_s

        with arming.checking():
            checking = asyncio.ensure_future(self._every_check(trajectory))
            await self._unless(ended, checking)
            if ended():
                why = arming.called_off or self.loop.flight.reason or f"it went to phase {self.phase}"
                raise FlightError(f"cannot arm: {why}")
        checking.result()

    async def _every_check(self, trajectory: Trajectory | None) -> None:
        await self.require_ground()
        self.arms.check_ready()
        if trajectory is not None:
            await check_room(trajectory, self._config)
        refused = refusal(await self.checks(trajectory))
        if refused:
            raise FlightError(refused)

    async def _while_preparing(self, call: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """What insists, as long as nobody has ended the preparation: an arming must not go on after a kill."""
        self._expect(Phase.PREFLIGHT)
        calling = asyncio.ensure_future(call())
        await self._unless(lambda: self.phase not in {Phase.PREFLIGHT, Phase.ARMED}, calling)
        if calling.cancelled():
            self._expect(Phase.ARMED)
        calling.result()

    async def _unless(self, ended: Callable[[], bool], doing: "asyncio.Future[None]") -> None:
        """Wait for what is being done; it is cancelled when it is ended from elsewhere."""
        try:
            await self.until(lambda: doing.done() or ended(), math.inf)
        finally:
            doing.cancel()
            await asyncio.gather(doing, return_exceptions=True)

    async def _disarm_again(self) -> None:
        """Arming was asked for, whether or not it shows yet: ask for the opposite."""
        try:
            await self._autopilot.disarm()
        except CompanionError as error:
            LOG.error("not disarmed: %s", error)  # noqa: TRY400 - the sentence is for the operator

    async def take_off(self, height_m: float) -> None:
        """Climb to `height_m` above where the vehicle stands, and hold there.

        FlightError where the fence is too near, and where an order held the vehicle below: then it stays there.
        """
        vehicle = self.loop.estimate.vehicle
        check_climb(height_m, None if vehicle is None else vehicle.position_w_m, self._config)
        self._ask(TakeoffRequest(height_m), "take off")
        rules = self._config.flight_rules()
        climb_s = minimum_jerk_duration_s(height_m, rules.climb_speed_mps, rules.climb_accel_mps2)
        await self._reach(Phase.HOLD, climb_s + self._config.flight.spool_up_s + _CLIMB_MARGIN_S)
        held_m = self._held_at_m()
        if abs(held_m - height_m) > _SAME_HEIGHT_M:
            raise FlightError(f"{ended_by(self.loop.flight)} at {held_m:.2f} m, not at {height_m:g} m")

    def _held_at_m(self) -> float:
        """Height of what is flown at last above where the vehicle stood."""
        flight = self.loop.flight
        ground_m = 0.0 if flight.ground_w_m is None else float(flight.ground_w_m[2])
        return float(flight.legs[-1].trajectory.at(0.0).position_w_m[2]) - ground_m

    async def go_to(self, position_w_m: Array, yaw_rad: float, taken: Callable[[], None] = _nothing) -> None:
        """Fly straight to a place (3,) in W and a heading there, and hold; `taken` is called once it has begun.

        Before anything moves, ConfigError where it lies out of the room, FlightError where it is too near the fence.
        """
        place = Hold(position_w_m, yaw_rad)
        await check_room_and_fence(place, self._config)
        self._ask(TrackRequest(place, 0.0), "go there")
        taken()
        way, *_, end = self.loop.flight.legs
        most_s = way.trajectory.duration_s + _APPROACH_MARGIN_S
        if not await self.until(lambda: self.loop.flight.legs == (end,) or self._diverted(end), most_s):
            raise FlightError(f"the place was not reached within {most_s:.0f} s")
        await asyncio.sleep(self._config.flight.settle_s)
        self._expect(Phase.HOLD, end)

    async def fly(self, trajectory: Trajectory, taken: Callable[[], None] = _nothing) -> None:
        """Go to the trajectory's start, fly it, hold its end; `taken` is called once it has begun.

        Before anything moves, ConfigError where it leads out of the room or is too fast, FlightError where it comes
        too near the fence; the vehicle goes on as it was.
        """
        await check_room_and_fence(trajectory, self._config)
        settle_s = self._config.flight.settle_s
        self._ask(TrackRequest(trajectory, settle_s), "fly a trajectory")
        taken()
        way, *_, end = self.loop.flight.legs
        await self._reach(Phase.TRACK, way.trajectory.duration_s + settle_s + _APPROACH_MARGIN_S, Phase.HOLD, end)
        await self._reach(Phase.HOLD, trajectory.duration_s + _CLIMB_MARGIN_S, end=end)
        await asyncio.sleep(settle_s)
        self._expect(Phase.HOLD, end)

    async def hold(self) -> None:
        """Brake and hover; what was flown is not taken up again."""
        self._ask(HoldRequest(), "hold")

    async def resume(self) -> None:
        """Take the vehicle back from the autopilot or its pilot, and hover where it is."""
        self._ask(ResumeRequest(), "take the vehicle back")
        await self._reach(Phase.HOLD, self._config.px4.answer_timeout_s)

    async def disarm(self) -> None:
        """Ask the autopilot itself; AutopilotError when it refuses."""
        await self._autopilot.disarm()

    async def kill(self) -> None:
        """Stop the motors at once, wherever the vehicle is; whoever calls this has had it confirmed."""
        self._ask(KillRequest(), "stop the motors")
        if not await self.until(lambda: not self._autopilot.status().armed, self._config.px4.answer_timeout_s, True):
            raise FlightError(f"the autopilot is still armed: {self.loop.action_failure or 'it does not answer'}")

    async def land(self, reason: str = "") -> None:
        """Come down where the vehicle is, stop the motors, disarm. From any phase; on the ground it only calls an
        arming off. `reason` is for the operator, when nobody commanded it.

        Whoever else has the vehicle is waited for, and commanded nothing. When the flight loop has failed it has told
        the autopilot to land: then the autopilot's landing is awaited.
        """
        if self.phase in {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED}:
            self.loop.arming.call_off(reason or "a landing was ordered")
            return
        if self.phase is not Phase.HANDED_OVER:
            self.loop.ask(LandRequest(reason))
        vehicle = self.loop.estimate.vehicle
        height_m = abs(float(vehicle.position_w_m[2])) if vehicle else 0.0
        down_s = height_m / self._config.flight.descent_speed_mps

        def down() -> bool:
            status = self._autopilot.status()
            over = self._ticking.done() or self.phase in {Phase.DISARMED, Phase.TERMINATED}
            return not status.connected or (over and not status.armed)

        stow_s = self._config.arms.stow_time_s if self._config.arms else 0.0
        landed = await self.until(down, stow_s + down_s + _LANDING_MARGIN_S, although_failed=True)
        if not self._autopilot.status().connected:
            raise FlightError("the autopilot is not heard any more: look at the vehicle")
        if not landed:
            raise FlightError(
                f"the autopilot is still armed after landing: {self.loop.action_failure or f'phase {self.phase}'}"
            )

    def _ask(self, wanted: Request, what: str) -> None:
        refusal = self.loop.refusal(wanted)
        if refusal or not self.loop.ask(wanted):
            before = f" ({self.loop.flight.reason})" if self.loop.flight.reason else ""
            raise FlightError(f"cannot {what}: {refusal}{before}")

    def _diverted(self, end: Leg | None) -> bool:
        """Whether something else is flown than what ends so."""
        legs = self.loop.flight.legs
        return end is not None and bool(legs) and legs[-1] is not end

    def _expect(self, phase: Phase, end: Leg | None = None) -> None:
        if self.phase is not phase or self.loop.flight.level > FailsafeAction.WARN or self._diverted(end):
            raise FlightError(ended_by(self.loop.flight))

    async def _reach(
        self, phase: Phase, timeout_s: float, through: Phase | None = None, end: Leg | None = None
    ) -> None:
        """Wait for a phase; leaving the phases on the way there means that the flight went another way.

        So does, in flight, an end that is not the last of what is flown any more: somebody ordered something else.
        """
        on_the_way = {self.phase, through}

        def over() -> bool:
            return self.phase is phase or self.phase not in on_the_way or self._diverted(end)

        if not await self.until(over, timeout_s):
            raise FlightError(f"phase {phase} was not reached within {timeout_s:.0f} s, it is still {self.phase}")
        self._expect(phase, end)

    async def until(self, true: Callable[[], bool], timeout_s: float, although_failed: bool = False) -> bool:
        """Poll; False after the time-out. Raises what stopped the flight loop, unless `although_failed`."""
        clock = asyncio.get_running_loop()
        end_s = clock.time() + timeout_s
        while not true():
            if self._ticking.done() and not although_failed:
                self._ticking.result()
            if clock.time() > end_s:
                return False
            await asyncio.sleep(_POLL_S)
        return True
