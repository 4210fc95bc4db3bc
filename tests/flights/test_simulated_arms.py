"""Whole flights with both arms moving, in simulated time: what they do to the flight, and the flight to them."""

import asyncio
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Any

import numpy as np
import pytest

from companion.arms.model import JOINT_NAMES
from companion.arms.planning import Plan, plan
from companion.arms.state_machine import ArmPhase
from companion.config.arm_files import motion_named
from companion.config.arms_config import ArmsConfig, Feedforward
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import MocapError
from companion.core.types import Array
from companion.preflight.checks.check import Check
from companion.protocol.check import Tell
from companion.service.flight_actions import DeviceReports, FlightActions
from companion.supervisor.flight_state import LandRequest, Phase, TrackRequest
from companion.trajectories.reference import Ellipse, LapTiming
from tests.flights.command import ROOT
from tests.flights.simulated import BRISK, Flight, Step, fly
from tests.flights.test_simulated_flights import DOWN, QUICK_UP, ask, until, wait
from tests.mock_autopilot.bench import IMPERFECT

pytestmark = pytest.mark.slow

LAP = Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=12.0, laps=1))
ARMS = ArmsConfig()
STEP_RAD = 3.0 * 0.01
"""No joint may be asked to go faster than its 3 rad/s."""
COMPARED_S = 8.0
"""Laps are compared by their first half."""


def mock_arms() -> dict[str, Any]:
    """Return the arms of config/mock.toml, stowed at boot, without a pseudo-terminal."""
    table: dict[str, Any] = tomllib.loads((ROOT / "config" / "mock.toml").read_text(encoding="utf-8"))["arms"]
    del table["bus"]["link"]
    return table


def swing(for_s: float = 60.0) -> Plan:
    motion = motion_named("swing", for_s).trajectory(ARMS.model(), ARMS.stow_rad())
    return plan(ARMS.model(), motion, ARMS.stow_rad())


def torque(flight: Flight) -> bool:
    assert flight.loop.arms is not None
    asyncio.get_running_loop().create_task(flight.loop.arms.torque_on(), name="torque")
    return True


def play(motion: Plan) -> Step:
    def step(flight: Flight) -> bool:
        assert flight.loop.arms is not None
        flight.loop.arms.play(motion.trajectory, flight.phase)
        return True

    return step


def arm_phases(flight: Flight) -> list[ArmPhase]:
    seen: list[ArmPhase] = []
    for tick in flight.ticks:
        assert tick.arms is not None
        if not seen or tick.arms.phase is not seen[-1]:
            seen.append(tick.arms.phase)
    return seen


def error_w_m(flight: Flight) -> Array:
    return np.array(
        [
            truth - tick.reference.position_w_m
            for tick, truth in zip(flight.ticks, flight.truths_w_m, strict=True)
            if tick.flight.phase is Phase.TRACK and tick.reference is not None
        ]
    )


def mean_error_x_m(flight: Flight) -> float:
    """Return the mean error along x in the part of the lap that is compared."""
    cycles = round(COMPARED_S / 0.01)
    assert len(error_w_m(flight)) >= cycles
    return float(np.abs(error_w_m(flight)[:cycles, 0]).mean())


def fail(flight: Flight) -> bool:
    assert flight.servos is not None
    flight.servos.fail("left.elbow_pitch")
    return True


def watch(seen: list[Flight]) -> Step:
    def step(flight: Flight) -> bool:
        seen.append(flight)
        return True

    return step


FLOWN: dict[str, Flight] = {}
"""The same flight is flown once for all who look at it: it would be the same again, bit by bit."""


class End(StrEnum):
    """End of a flight with a lap: after COMPARED_S of it, in the hover behind it, or on the ground."""

    COMPARED, HOLDS, LANDS = "compared", "holds", "lands"


async def lap(
    *,
    swinging: bool = True,
    end: End = End.LANDS,
    mock: dict[str, Any] | None = None,
    estimator: Mapping[str, Any] = IMPERFECT,
    **changes: Any,
) -> Flight:
    """Fly a lap of the ellipse; `mock` changes the simulated arms, `changes` the companion's [arms].

    Who only asks for the error on the path need not see it land.
    """
    key = repr((swinging, end, mock, estimator, changes))
    if key not in FLOWN:
        config = CompanionConfig(flight=BRISK, arms=ARMS.model_copy(update=changes))
        begin = [play(swing())] if swinging else []
        there = [torque, wait(0.5), *QUICK_UP, *begin, ask(TrackRequest(LAP, 0.5)), until(Phase.TRACK)]
        then = {End.COMPARED: [wait(COMPARED_S)], End.HOLDS: [until(Phase.HOLD)]}
        then[End.LANDS] = [*then[End.HOLDS], wait(0.5), *DOWN]
        arms = mock_arms() | (mock or {})
        FLOWN[key] = await fly([wait(0.2), *there, *then[end]], config=config, arms=arms, estimator=estimator)
    return FLOWN[key]


async def still_lap() -> Flight:
    """The arms do not move, and go limp after landing."""
    return await lap(swinging=False, torque_off_after_landing=True)


async def test_a_flight_with_swinging_arms_stows_them_and_lands() -> None:
    flight = await lap()
    assert flight.phases()[-5:] == [Phase.TRACK, Phase.HOLD, Phase.STOW, Phase.LAND, Phase.DISARMED]
    assert arm_phases(flight) == [
        ArmPhase.OFF, ArmPhase.HOLDING, ArmPhase.MOVING, ArmPhase.HOLDING, ArmPhase.STOWING, ArmPhase.HOLDING
    ]  # fmt: skip
    assert flight.loop.flight.reason == ""
    landing = next(tick for tick in flight.ticks if tick.flight.phase is Phase.LAND)
    assert landing.arms is not None
    assert np.abs(landing.arms.status.position_rad - ARMS.stow_rad())[:3].max() < ARMS.stowed_within_rad
    error = np.abs(error_w_m(flight))
    assert error.mean(axis=0).max() < 0.05
    assert error.max() < 0.20


async def test_the_arms_really_disturb_the_flight_and_the_feed_forward_takes_most_of_it_away() -> None:
    still, told, untold = [
        mean_error_x_m(flight)
        for flight in (await still_lap(), await lap(), await lap(feedforward=Feedforward.OFF, end=End.COMPARED))
    ]
    assert untold > 3.0 * still, "swinging arms shift the centre of mass: without being told, the law is off along x"
    assert told < 0.5 * untold


@pytest.mark.parametrize("inertia_kgm2", [(0.077, 0.07, 0.091), (0.143, 0.13, 0.169)])
async def test_the_feed_forward_still_helps_when_the_inertia_is_wrong_by_a_third(
    inertia_kgm2: tuple[float, float, float],
) -> None:
    told, untold = [
        mean_error_x_m(flight)
        for flight in (
            await lap(mock={"inertia_kgm2": inertia_kgm2}, end=End.COMPARED),
            await lap(feedforward=Feedforward.OFF, end=End.COMPARED),
        )
    ]
    assert told < 0.7 * untold


async def test_goals_never_jump() -> None:
    flight = await lap()
    assert flight.servos is not None
    goals = np.array(flight.servos.goals_rad)
    assert np.abs(np.diff(goals, axis=0)).max() < STEP_RAD
    start = mock_arms()["bus"]["servos"][1]["start_position_rad"] - np.pi
    assert goals[0][1] == pytest.approx(start, abs=1e-2), "the first goal is where the joint was"


async def failed_lap() -> Flight:
    """A servo fails on the way."""
    if "failed" not in FLOWN:
        script = [
            torque,
            wait(0.5),
            *QUICK_UP,
            play(swing()),
            ask(TrackRequest(LAP, 0.5)),
            until(Phase.TRACK),
            wait(4.0),
            fail,
        ]
        FLOWN["failed"] = await fly([*script, until(Phase.DISARMED)], arms=mock_arms())
    return FLOWN["failed"]


async def test_a_servo_fault_in_flight_stops_the_arms_and_lands() -> None:
    flight = await failed_lap()
    assert flight.phases()[-3:] == [Phase.TRACK, Phase.LAND, Phase.DISARMED], "no stowing with a broken servo"
    assert flight.loop.flight.reason == "left.elbow_pitch (servo 6): overload"
    assert flight.loop.flight.touched_down
    assert arm_phases(flight)[-1] is ArmPhase.FAULT
    assert flight.servos is not None
    assert flight.servos.holds == 1
    failed_at = next(n for n, tick in enumerate(flight.ticks) if tick.arms and tick.arms.phase is ArmPhase.FAULT)
    after = [tick.arms for tick in flight.ticks[failed_at:]]
    assert all(arms is not None and arms.goal is None for arms in after), "no goal is sent any more"
    later = np.array([arms.status.position_rad for arms in after if arms is not None][100:])
    assert np.ptp(later, axis=0).max() < 0.02, "the arms hold still all the way down"
    assert bool(after[-1] and after[-1].status.torque_on.all()), "and do not go limp"


async def test_a_servo_fault_may_leave_the_flight_alone() -> None:
    config = CompanionConfig(flight=BRISK, arms=ARMS.model_copy(update={"land_on_fault": False}))
    flight = await fly(
        [torque, wait(0.5), *QUICK_UP, play(swing()), wait(2.0), fail, wait(1.0)], arms=mock_arms(), config=config
    )
    assert flight.phase is Phase.HOLD
    assert arm_phases(flight)[-1] is ArmPhase.FAULT


async def test_a_bus_thread_that_hangs_is_a_fault_though_it_says_nothing() -> None:
    def hang(flight: Flight) -> bool:
        assert flight.servos is not None
        flight.servos.hung = True
        return True

    flight = await fly([torque, wait(0.5), *QUICK_UP, wait(0.2), hang, until(Phase.DISARMED)], arms=mock_arms())
    assert flight.loop.flight.reason == "bus: no servo was read for 0.5 s"
    assert flight.loop.flight.touched_down


async def test_handed_over_arms_are_folded_before_the_autopilot_lands() -> None:
    mocap = {"silences": [{"start_s": 14.0, "for_s": 100.0}]}
    flight = await fly(
        [torque, wait(0.5), *QUICK_UP, play(swing()), until(Phase.HANDED_OVER), wait(4.0)],
        arms=mock_arms(),
        mocap=mocap,
    )
    assert ArmPhase.STOWING in arm_phases(flight)
    assert flight.loop.arms is not None
    assert flight.loop.arms.off_stow == ""


async def test_limp_arms_are_let_be_and_the_torque_goes_after_landing_only_if_configured() -> None:
    assert arm_phases(await still_lap())[-1] is ArmPhase.OFF
    kept = await lap()
    assert arm_phases(kept)[-1] is ArmPhase.HOLDING


async def test_where_a_joint_is_not_stowed_is_said() -> None:
    table = mock_arms()
    table["bus"]["servos"][5]["start_position_rad"] = 4.2
    flight = await fly([torque, wait(0.2)], arms=table)
    assert flight.loop.arms is not None
    assert flight.loop.arms.off_stow.startswith(f"{JOINT_NAMES[5]} is 7")


async def test_a_mistake_in_the_arms_software_lands_the_vehicle() -> None:
    def break_it(flight: Flight) -> bool:
        assert flight.loop.arms is not None
        state = flight.loop.arms.state
        flight.loop.arms._state = replace(state, motion=object())  # type: ignore[arg-type]
        return True

    flight = await fly([torque, wait(0.5), *QUICK_UP, wait(0.2), break_it, until(Phase.DISARMED)], arms=mock_arms())
    assert flight.loop.flight.reason.startswith("the arms' software failed: AttributeError")
    assert flight.loop.flight.touched_down


async def test_a_motion_that_has_hardly_left_the_stowed_pose_is_folded_back_before_landing() -> None:
    script = [torque, wait(0.5), *QUICK_UP, play(swing()), wait(0.35), *DOWN]
    flight = await fly([wait(0.2), *script], arms=mock_arms())
    assert Phase.STOW in flight.phases()
    assert flight.loop.arms is not None
    assert flight.loop.arms.stowed
    assert flight.loop.flight.reason == ""


async def test_when_the_flight_loop_itself_ends_the_arms_still_fold() -> None:
    script = [torque, wait(0.5), *QUICK_UP, play(swing()), wait(60.0)]
    seen: list[Flight] = []
    with pytest.raises(MocapError):
        await fly([watch(seen), *script], arms=mock_arms(), mocap_lost_at_s=13.0)
    [flight] = seen
    assert flight.phase is Phase.HANDED_OVER
    assert flight.autopilot.land_calls == 1
    assert flight.loop.arms is not None
    assert flight.loop.arms.stowed, "the autopilot lands on what hangs below"


async def test_a_vehicle_that_comes_down_on_hanging_arms_stops_its_motors() -> None:
    """The floor of this room holds the body's origin; raised by 0.3 m in flight it is what hanging arms stand on."""

    def raise_the_floor(flight: Flight) -> bool:
        world = flight.room.bench.world
        world._params = replace(world._params, ground_z_m=-0.3)
        return True

    script = [torque, wait(0.5), *QUICK_UP, play(swing()), wait(3.0), raise_the_floor, fail, until(Phase.DISARMED)]
    flight = await fly(script, arms=mock_arms())
    assert flight.loop.flight.touched_down
    assert flight.loop.flight.reason == "left.elbow_pitch (servo 6): overload"
    assert flight.truths_w_m[-1][2] == pytest.approx(0.3, abs=0.01)


async def test_what_the_law_is_told_does_not_jump_when_a_servo_fails() -> None:
    flight = await failed_lap()
    told = np.array([tick.arms.known_accel_w_mps2 for tick in flight.ticks if tick.arms is not None])
    assert np.abs(told).max() > 0.3
    assert np.abs(np.diff(told, axis=0)).max() < 0.1


async def no_params(_: Sequence[str]) -> dict[str, float]:
    return {}


async def _no_preflight(_: Tell) -> Sequence[Check]:
    raise AssertionError("nobody arms")


async def test_a_service_knows_of_a_fault_that_did_not_end_the_flight() -> None:
    script = [torque, wait(0.5), *QUICK_UP, wait(0.5), ask(LandRequest()), wait(1.0), fail, until(Phase.DISARMED)]
    flight = await fly(script, arms=mock_arms())
    assert flight.loop.flight.reason == "", "it was landing anyway"
    ticking = asyncio.get_running_loop().create_task(asyncio.sleep(0), name="ticking")
    reports = DeviceReports(_no_preflight, no_params)
    service = FlightActions(flight.loop, flight.autopilot, CompanionConfig(arms=ARMS), ticking, reports)
    await ticking
    assert service.trouble == "left.elbow_pitch (servo 6): overload"
    assert flight.loop.arms is not None
    await flight.loop.arms.clear_faults()
    flight.loop.arms.read(flight.room.now_s(), flight.loop.flight)
    assert service.trouble == ""
