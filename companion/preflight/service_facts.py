"""The preflight of a running service: gathers the facts from its devices, in about two seconds."""

import asyncio
import ctypes
import math
import os
import stat
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

import numpy as np

from companion import __version__
from companion.adapters.px4.telemetry import LocalEstimate
from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import LawLinkConfig
from companion.config.law_margin import REMEDY, margin_of
from companion.config.preflight_config import PreflightConfig, load_recommended
from companion.core.interfaces import Clock, ConfigError, GroundPoses, MocapSource
from companion.core.types import Array, AutopilotStatus, OtherService
from companion.estimation.estimator import EstimatorState
from companion.estimation.others import vehicles_of
from companion.flight.arm_step import ArmStep
from companion.flight.assembly import controller_of, period_s
from companion.geometry.frames import quat_from_yaw
from companion.law_link.link_status import LinkStatus
from companion.preflight.checks.agreement import Difference, VisionFacts, apart, settles
from companion.preflight.checks.all_checks import CURVE, DELAY, HOVER, Facts, check_all, check_early
from companion.preflight.checks.check import Check
from companion.preflight.checks.computer import ComputerFacts
from companion.preflight.checks.law_link import LawLinkFacts
from companion.preflight.checks.mocap import MocapFacts, MocapWatch, median
from companion.preflight.checks.other_vehicles import OtherVehicleFacts
from companion.preflight.checks.vehicle import ServoFacts, check_parameters
from companion.preflight.checks.without_frames import GroundPoseFacts
from companion.preflight.hand_test_file import read_hand_test
from companion.protocol.check import Tell
from companion.trajectories.reference import Trajectory

_WATCH_S = 1.0
_POLL_S = 0.002
_PAIR_S = 0.02
_SETTLE_S = 6.0
"""EKF2 takes some 2 s to trust vision; its flags and the battery's state come once in 1 and 2 s."""
_SETTLE_POLL_S = 0.05
_HORIZON_S = 20.0
_LEVEL_SHARE = 0.9
"""Share of the allowed difference: the check itself runs a second later, with noise."""
_TELL_S = 1.0
_FLAGS_S = 3.0
"""Older flags are worth nothing."""
_UNSYNCHRONISED = 5
"""TIME_ERROR of adjtimex(2)."""
_TIMEX_BYTES = 512


class Answering(Protocol):
    """An autopilot that is looked at and asked, and not commanded."""

    def status(self) -> AutopilotStatus:
        """Return the autopilot's status, as core.interfaces.Autopilot does."""

    def local(self) -> LocalEstimate:
        """Return the autopilot's own local position estimate; never waits."""

    async def params(self, names: Sequence[str]) -> dict[str, float]:
        """Return values of its parameters; unknown ones are absent."""


def _ignore(text: str, checks: Sequence[Check] = ()) -> None:
    """Take what is waited for, for nobody."""


@dataclass(frozen=True, kw_only=True)
class Running:
    """Devices that a preflight reads; kept current by a flight loop or an observer."""

    mocap: MocapSource
    autopilot: Answering
    clock: Clock
    estimate: Callable[[], EstimatorState]
    arms: ArmStep | None = None
    disk_free_mb: Callable[[], float] | None = None
    """None: nothing is recorded to disk."""
    operator_age_s: Callable[[], float] | None = None
    """Since the operator's broker last answered, s, 0 while it does; None: none is configured."""
    others: Callable[[], tuple[OtherService, ...]] = tuple
    """Services of other vehicles on the broker; only a service hears them."""
    arms_remarks: tuple[str, ...] = ()
    """Remarks of connecting about the servos or their port."""
    landed_age_s: Callable[[], float] = lambda: math.inf
    """Since the last flight, before which both attitudes agreed, ended; infinite when none is known."""
    tell: Tell = _ignore
    law_loaded: bool = False
    """A service has a law, whose margins were looked at when it was loaded."""
    law_link: Callable[[], LinkStatus] | None = None
    """State of the link to a law on the ground; None for a law on board."""
    ground_poses: GroundPoses | None = None
    """Poses of a law on the ground, on a vehicle that frames do not reach; None where they do."""


async def preflight(
    running: Running, config: CompanionConfig, trajectory: Trajectory | None = None
) -> tuple[Check, ...]:
    """Run every check. Takes a second, and up to 6 s more while the autopilot settles on vision, or 20 s on a horizon
    that a flight has left off.

    Poses must go to the autopilot meanwhile. Raises ConfigError when the list of parameters cannot be used.
    """
    wanted = config.preflight
    recommended = load_recommended(wanted.parameters)
    names = [*recommended, DELAY, HOVER, CURVE]
    early = check_early(machine_of(running), running.autopilot.status(), config, wanted)
    running.tell("asking the autopilot for its parameters, and waiting until it has settled on motion capture", early)
    _, parameters = await asyncio.gather(settle(running, wanted), running.autopilot.params(names))
    known = (*early, *check_parameters(recommended, parameters))
    running.tell(f"watching motion capture and the autopilot for {_WATCH_S:g} s", known)
    watched = await watch(running, config.mocap.body, config.mocap.delay_s, _WATCH_S)
    facts = facts_of(running, watched, parameters, wanted)
    if config.law.on_ground:
        facts = replace(facts, law_link=law_link_facts(running, config.law.link))
    elif not running.law_loaded:
        facts = replace(facts, law=await asyncio.to_thread(check_configured_law, config))
    return check_all(facts, config, wanted, recommended, trajectory)


def check_configured_law(config: CompanionConfig) -> Check:
    """Return whether the law that `control.controller` names can be loaded, and has enough margin on this vehicle."""
    name = config.control.controller
    try:
        loaded = controller_of(config, name)
    except ConfigError as error:
        return Check("control law", False, f"{name} cannot be loaded: {error}", "mend its file")
    margin = margin_of(loaded, config.vehicle_model(), period_s(config))
    return Check("control law", margin.enough or loaded.unstable_allowed, f"{name}: {margin.says}", REMEDY)


async def settle(running: Running, wanted: PreflightConfig) -> bool:
    """Wait a while until what comes late is there: vision fused, heading taken over, battery known, broker met.

    And longer after a flight, before which both attitudes agreed, until they do again.
    """

    def settled() -> bool:
        ours, status = _attitude(running), running.autopilot.status()
        if ours is None or math.isnan(status.battery_fraction) or not _fused(running) or _operator_age_s(running):
            return False
        if not _link_known(running):
            return False
        off = apart(ours[None], status.q_w_flu_wxyz[None])
        return abs(off.heading_rad) <= wanted.heading_apart_rad

    begun_s = running.clock.now_s()
    while not settled():
        if running.clock.now_s() > begun_s + _SETTLE_S:
            return False
        await asyncio.sleep(_SETTLE_POLL_S)
    return await _horizon_settled(running, wanted.tilt_apart_rad, begun_s + _HORIZON_S)


async def _horizon_settled(running: Running, most_rad: float, end_s: float) -> bool:
    """Wait until PX4's horizon agrees again after a flight; True at once where it has no reason to be off."""
    tell_due_s = -math.inf
    while settles(tilt_rad := _tilt_apart_rad(running), running.landed_age_s()) and tilt_rad > _LEVEL_SHARE * most_rad:
        now_s = running.clock.now_s()
        if now_s > end_s:
            return False
        if now_s >= tell_due_s:
            tell_due_s = now_s + _TELL_S
            running.tell(
                f"PX4's horizon is still {math.degrees(tilt_rad):.1f} degrees off after the flight: waiting until it "
                f"is below {math.degrees(most_rad):.1f}, for up to {end_s - now_s:.0f} s"
            )
        await asyncio.sleep(_SETTLE_POLL_S)
    return True


def _tilt_apart_rad(running: Running) -> float:
    """Return the larger of roll and pitch between motion capture and autopilot; NaN when one is not known."""
    vehicle = running.estimate().vehicle
    if vehicle is None:
        return math.nan
    off = apart(vehicle.q_w_flu_wxyz[None], running.autopilot.status().q_w_flu_wxyz[None])
    return max(abs(off.roll_rad), abs(off.pitch_rad))


def _attitude(running: Running) -> Array | None:
    """Return the attitude by motion capture, (4,); level with the ground's heading where frames do not reach us."""
    vehicle = running.estimate().vehicle
    if vehicle is None or running.ground_poses is None:
        return None if vehicle is None else vehicle.q_w_flu_wxyz
    pose = running.ground_poses.latest_pose()
    return None if pose is None else quat_from_yaw(pose.yaw_rad)


def _fused(running: Running) -> bool:
    local = running.autopilot.local()
    return local.vision_fused and running.clock.now_s() - local.flags_s < _FLAGS_S


def _operator_age_s(running: Running) -> float:
    return running.operator_age_s() if running.operator_age_s is not None else 0.0


def _link_known(running: Running) -> bool:
    """Return True if nothing more is to come from the ground's law: it was refused, or all is measured."""
    if running.law_link is None:
        return True
    link = running.law_link()
    return math.isfinite(link.age_s) if link.connected else bool(link.refused)


def law_link_facts(running: Running, link: LawLinkConfig) -> LawLinkFacts | None:
    """Return the state of the link and of its key's file; None where no link is open."""
    if running.law_link is None:
        return None
    name = str(link.key_file)
    try:
        mode = stat.S_IMODE(Path(name).stat().st_mode)
    except OSError:
        mode = None
    return LawLinkFacts(
        status=running.law_link(),
        version=__version__,
        where=f"{link.listen}, UDP port {link.port}",
        key_file=name,
        key_mode=mode,
    )


@dataclass(frozen=True)
class Watched:
    """Observation of motion capture and of both attitudes over some seconds."""

    mocap: MocapFacts
    apart: Difference
    vision_apart_m: float
    ground: GroundPoseFacts | None
    """None where frames reach the vehicle."""


async def watch(
    running: Running, body: str, delay_s: float, for_s: float, enough: Callable[[], bool] = lambda: False
) -> Watched:
    """Observe mocap, of configured delay `delay_s`, and the autopilot for `for_s`, or until `enough` returns True."""
    clock, mocap = running.clock, MocapWatch(running.mocap, running.estimate, delay_s)
    ours, theirs, distances_m = list[Array](), list[Array](), list[float]()
    begun_s = now_s = pair_due_s = clock.now_s()
    before = _poses_taken(running)
    while now_s - begun_s < for_s and not enough():
        mocap.look(now_s)
        vehicle, attitude = running.estimate().vehicle, _attitude(running)
        if vehicle is not None and attitude is not None and now_s >= pair_due_s:
            pair_due_s = now_s + _PAIR_S
            ours.append(attitude)
            theirs.append(running.autopilot.status().q_w_flu_wxyz)
            distances_m.append(float(np.linalg.norm(running.autopilot.local().position_w_m - vehicle.position_w_m)))
        await asyncio.sleep(_POLL_S)
        now_s = clock.now_s()
    off, taken = apart(np.array(ours).reshape(-1, 4), np.array(theirs).reshape(-1, 4)), _poses_taken(running) - before
    ground = None if running.ground_poses is None else GroundPoseFacts(taken, now_s - begun_s)
    return Watched(mocap.seen(body, now_s - begun_s), off, median(distances_m), ground)


def _poses_taken(running: Running) -> int:
    """Return the number of poses or frames that the estimate has used so far."""
    counts = running.estimate().counts
    return counts.accepted + counts.started


def facts_of(running: Running, watched: Watched, parameters: Mapping[str, float], wanted: PreflightConfig) -> Facts:
    """Return the facts from the collected samples and the present state."""
    vehicle, now_s = running.estimate().vehicle, running.clock.now_s()
    return Facts(
        time_s=now_s,
        when=datetime.now(tz=UTC),
        mocap=watched.mocap,
        position_w_m=vehicle.position_w_m if vehicle is not None else None,
        status=running.autopilot.status(),
        apart=watched.apart,
        vision=VisionFacts(_fused(running), watched.vision_apart_m),
        ground=watched.ground,
        parameters=parameters,
        arms=_arms_of(running, now_s),
        machine=machine_of(running),
        kept=read_hand_test(wanted),
        operator_age_s=_operator_age_s(running),
        landed_age_s=running.landed_age_s(),
        others=running.others(),
        vehicles=_vehicles_of(running),
    )


def _vehicles_of(running: Running) -> OtherVehicleFacts:
    frame, estimate = running.mocap.latest(), running.estimate()
    return OtherVehicleFacts(() if frame is None else frame.others, vehicles_of(estimate.others, estimate.others_s))


def _arms_of(running: Running, now_s: float) -> ServoFacts | None:
    arms = running.arms
    if arms is None:
        return None
    return ServoFacts(now_s - float(arms.status.read_s.min()), arms.fault, arms.off_stow, running.arms_remarks)


def machine_of(running: Running) -> ComputerFacts:
    """Return the state of this computer and of this process, whose main thread runs the control loop."""
    realtime = os.sched_getscheduler(0) in {os.SCHED_FIFO, os.SCHED_RR}
    return ComputerFacts(
        running.disk_free_mb() if running.disk_free_mb is not None else math.inf,
        time.get_clock_info("monotonic").resolution,
        time.time() >= Path(__file__).stat().st_mtime,
        _synchronised(),
        os.sched_getparam(0).sched_priority if realtime else 0,
        os.getpriority(os.PRIO_PROCESS, 0),
    )


def _synchronised() -> bool | None:
    """Return whether a time service synchronizes the system clock, by adjtimex(2); None when unknown."""
    state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))  # modes = 0: only asks
    return None if state < 0 else state != _UNSYNCHRONISED
