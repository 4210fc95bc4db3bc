"""Whole flights of the flight loop in simulated time."""

from dataclasses import replace
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import VehicleConfig
from companion.control.controller import ControlInput, ControlOutput, VehicleModel
from companion.control.gains import PidGains
from companion.control.pid import Pid
from companion.core.types import Array, FlightMode
from companion.geometry.frames import up_axis, yaw_of
from companion.supervisor.flight_state import (
    ArmRequest,
    HandOverRequest,
    LandRequest,
    Phase,
    Request,
    TakeoffRequest,
    TrackRequest,
)
from companion.trajectories.reference import Ellipse, LapTiming
from tests.flights.simulated import BRISK, Flight, Step, fly
from tests.flights.simulated_ground import GroundSetup, ground_config

pytestmark = pytest.mark.slow

MODEL = VehicleModel()
LAP = Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=12.0, laps=1))


def ask(wanted: Request) -> Step:
    def step(flight: Flight) -> bool:
        assert not flight.loop.submit(wanted), f"{wanted} was refused in phase {flight.phase}"
        return True

    return step


def until(phase: Phase) -> Step:
    return lambda flight: flight.phase is phase


def wait(seconds: float) -> Step:
    """Return a step that waits from when it is first asked in a flight; it may be part of many flights."""
    ends: WeakKeyDictionary[Flight, float] = WeakKeyDictionary()  # a flight holds ten thousands of objects

    def step(flight: Flight) -> bool:
        return flight.room.now_s() >= ends.setdefault(flight, flight.room.now_s() + seconds)

    return step


def inject(sentence: str) -> Step:
    def step(flight: Flight) -> bool:
        flight.room.inject(sentence)
        return True

    return step


def command(number: int, *params: float) -> Step:
    def step(flight: Flight) -> bool:
        flight.autopilot.command(number, *params)
        return True

    return step


def checks_pass(flight: Flight) -> bool:
    """PX4's own checks before arming, which some boots end two seconds later than others."""
    vehicle = flight.room.bench.world.vehicle
    return vehicle.commander.checked(vehicle.failsafe_flags)


def end_checks(flight: Flight) -> bool:
    """End PX4's own checks, for which it takes 4 to 6 s from its boot."""
    flight.room.bench.world.vehicle.commander._checks_pass_s = 0.0
    return True


def pose_trusted(flight: Flight) -> bool:
    """PX4 trusts the pose that it is told."""
    return flight.room.bench.world.vehicle.estimator.local_ok


def shows_offboard(flight: Flight) -> bool:
    return flight.ticks[-1].status.mode is FlightMode.OFFBOARD


ARM = [
    wait(3.0),  # until PX4 trusts its pose
    ask(ArmRequest()),
    wait(0.3),
    command(176, 1.0, 6.0, 0.0),
    wait(1.2),
    checks_pass,
    command(400, 1.0),
    until(Phase.ARMED),
]
UP = [*ARM, ask(TakeoffRequest(1.2)), until(Phase.HOLD)]
QUICK_ARM = [
    end_checks,
    pose_trusted,
    ask(ArmRequest()),
    wait(0.2),  # PX4 wants setpoints before it is asked for OFFBOARD
    command(176, 1.0, 6.0, 0.0),
    shows_offboard,
    command(400, 1.0),
    until(Phase.ARMED),
]
"""Three seconds of simulated time less, for whom nothing before the takeoff matters."""
QUICK_UP = [*QUICK_ARM, ask(TakeoffRequest(1.2)), until(Phase.HOLD)]
DOWN = [ask(LandRequest()), until(Phase.DISARMED), wait(0.5)]


def _error_w_m(flight: Flight, phase: Phase) -> Array:
    """True position less the reference, at the ticks of a phase."""
    rows = [
        truth - tick.reference.position_w_m
        for tick, truth in zip(flight.ticks, flight.truths_w_m, strict=True)
        if tick.flight.phase is phase and tick.reference is not None
    ]
    return np.array(rows)


_FLOWN: dict[str, Flight] = {}
"""Flights that several tests look at, by name; the same again, bit by bit."""


def _standby_to_disarmed() -> list[Step]:
    return [*UP, ask(TrackRequest(LAP, 2.0)), until(Phase.TRACK), until(Phase.HOLD), wait(1.0), *DOWN]


async def _lap() -> Flight:
    """Fly from standby to disarmed, as configured by default."""
    if "lap" not in _FLOWN:
        _FLOWN["lap"] = await fly(_standby_to_disarmed(), config=CompanionConfig())
    return _FLOWN["lap"]


async def test_a_law_on_the_ground_flies_as_well_over_a_clean_link() -> None:
    onboard = await _lap()
    split = await fly(_standby_to_disarmed(), config=ground_config(CompanionConfig(), True), ground=GroundSetup())
    assert split.phases() == onboard.phases()
    here, there = (np.linalg.norm(_error_w_m(flight, Phase.TRACK), axis=1).mean() for flight in (onboard, split))
    assert there <= 1.1 * here, f"{there:.4f} m, on board {here:.4f} m"
    assert not {event.fault for tick in split.ticks for event in tick.events if tick.flight.airborne}


async def _silenced() -> Flight:
    """Motion capture falls silent on the path, and PX4 lands."""
    if "silenced" not in _FLOWN:
        track = [*QUICK_UP, ask(TrackRequest(LAP, 0.5)), until(Phase.TRACK), wait(3.0), inject("mocap off")]
        _FLOWN["silenced"] = await fly([*track, until(Phase.HANDED_OVER), until(Phase.DISARMED), wait(3.0)])
    return _FLOWN["silenced"]


async def test_a_flight_from_standby_to_disarmed() -> None:
    flight = await _lap()
    assert flight.phases() == [
        Phase.STANDBY, Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.HOLD, Phase.LAND,
        Phase.DISARMED,
    ]  # fmt: skip
    error = np.abs(_error_w_m(flight, Phase.TRACK))
    assert error.mean(axis=0).max() < 0.03, "the true vehicle follows the reference, friction and lag and all"
    assert error.max() < 0.10
    assert not flight.room.bench.world.vehicle.armed
    assert flight.truths_w_m[-1][2] == pytest.approx(0.0, abs=1e-3)
    assert flight.loop.flight.reason == ""
    texts = [sent.message.text for sent in flight.room.bench.sent if sent.type == "STATUSTEXT"]
    assert [text for text in texts if "denied" in text] == [], (
        "it is asked to disarm once its land detector has seen it"
    )


@pytest.mark.parametrize("yaw_rad", [0.8, -2.5])
async def test_where_it_stands_and_looks_does_not_matter(yaw_rad: float) -> None:
    start = {"start_position_ned_m": (0.5, -0.4, 0.0), "start_yaw_rad": -yaw_rad}
    flight = await fly([*QUICK_UP, wait(1.0), ask(TrackRequest(LAP, 2.0)), until(Phase.TRACK), wait(6.0)], start=start)
    climb = _error_w_m(flight, Phase.TAKEOFF)
    assert np.abs(climb).max() < 0.15
    above = next(tick for tick in flight.ticks if tick.flight.phase is Phase.HOLD)
    assert above.reference is not None
    assert above.reference.position_w_m == pytest.approx([0.5, 0.4, 1.2], abs=0.01)
    assert above.reference.yaw_rad == pytest.approx(yaw_rad, abs=0.02), "it climbs with the heading it had"
    assert np.abs(_error_w_m(flight, Phase.TRACK)).mean(axis=0).max() < 0.03
    assert flight.ticks[-1].vehicle is not None
    assert float(yaw_of(flight.ticks[-1].vehicle.q_w_flu_wxyz)) == pytest.approx(0.0, abs=0.05), "it turned to the path"


async def test_the_same_seed_gives_the_same_flight() -> None:
    script = [*QUICK_UP[:-1], lambda flight: bool(flight.room.truth_w_m[2] > 0.3)]
    one, two, other = [await fly(list(script), seed=seed) for seed in (3, 3, 4)]
    assert [t.tobytes() for t in one.truths_w_m] == [t.tobytes() for t in two.truths_w_m]
    assert [t.tobytes() for t in one.truths_w_m] != [t.tobytes() for t in other.truths_w_m]


async def test_the_law_sleeps_on_the_ground() -> None:
    flight = await _lap()
    for tick, truth in zip(flight.ticks, flight.truths_w_m, strict=True):
        if tick.flight.phase in {Phase.PREFLIGHT, Phase.ARMED}:
            assert tick.pipeline is None
            assert tick.limited is not None
            assert float(tick.limited.setpoint.thrust) == 0.0, "motors idle until takeoff"
        if tick.pipeline is not None:
            assert truth[2] > 0.005 or tick.flight.phase is Phase.LAND, "the law was awake on the ground"
    touched = [tick for tick in flight.ticks if tick.flight.touched_down and tick.limited is not None]
    assert all(tick.pipeline is None for tick in touched)
    assert float(touched[-1].limited.setpoint.thrust) == 0.0  # type: ignore[union-attr]


async def test_the_trigger_sends_a_fraction_of_the_cycles_and_every_setpoint_differs_from_the_last() -> None:
    flight = await _lap()
    for phase in (Phase.HOLD, Phase.TRACK):
        share = np.mean([np.isfinite(tick.sent_s) for tick in flight.ticks if tick.flight.phase is phase])
        assert 0.005 < share < 0.15, phase
    sent = [setpoint for _, setpoint in flight.autopilot.setpoints]
    for before, after in pairwise(sent[1:]):
        different = (before.q_w_flu_wxyz != after.q_w_flu_wxyz).any() or before.thrust != after.thrust
        assert different, "a setpoint that the autopilot already has was sent again"


@pytest.mark.parametrize("hover_thrust", [0.43, 0.58])
async def test_a_misjudged_hover_thrust_still_takes_off_and_holds(hover_thrust: float) -> None:
    config = CompanionConfig(vehicle=VehicleConfig(hover_thrust=hover_thrust), flight=BRISK)
    flight = await fly([*QUICK_UP, wait(6.0)], config=config)
    assert abs(flight.truths_w_m[-1][2] - 1.2) < 0.15


async def test_without_lift_off_px4_ends_it_with_a_reason() -> None:
    """Its land detector goes by the throttle: it does not say that a vehicle stands whose rotors turn fast."""
    flight = await fly([*QUICK_ARM, ask(TakeoffRequest(1.2)), until(Phase.DISARMED)], plant={"max_thrust_n": 70.0})
    assert Phase.HOLD not in flight.phases()
    assert "no lift-off seen at thrust 0.62, and PX4 does not say" in flight.loop.flight.reason
    assert all(truth[2] < 0.02 for truth in flight.truths_w_m)


async def test_silent_mocap_in_the_air_hands_over_to_the_autopilots_landing() -> None:
    flight = await _silenced()
    handed = next(tick for tick in flight.ticks if tick.flight.phase is Phase.HANDED_OVER)
    assert 0.25 < handed.age_s < 0.28
    assert "no usable pose for 0.2" in handed.flight.reason
    assert flight.autopilot.setpoints[-1][0] <= handed.time_s, "no setpoint after handing over"
    later = next(tick for tick in flight.ticks if tick.time_s > handed.time_s + 1.5)
    assert later.status.mode is FlightMode.LAND


async def test_an_autopilots_landing_that_ends_in_offboard_is_not_told_to_land_again() -> None:
    """PX4 v1.17 falls back to OFFBOARD when it disarms; CURRENT_MODE says so up to a second before HEARTBEAT."""
    flight = await _silenced()
    first = next(tick for tick in flight.ticks if tick.flight.phase is Phase.HANDED_OVER)
    back = [
        tick for tick in flight.ticks if tick.time_s > first.time_s + 1.0 and tick.status.mode is FlightMode.OFFBOARD
    ]
    assert any(tick.status.armed for tick in back), "the mode was shown before the armed bit"
    assert flight.autopilot.land_calls == 1
    assert flight.loop.flight.reason == first.flight.reason
    assert flight.autopilot.status().mode is FlightMode.OFFBOARD, "a NAV_LAND would leave it in LAND"


async def test_what_one_flight_was_refused_is_no_reason_of_the_next() -> None:
    flight = await fly([*QUICK_ARM, ask(LandRequest()), until(Phase.DISARMED)])
    flight.loop._calls.failure = "the autopilot refused to disarm: not landed"
    assert flight.loop.action_failure
    assert not flight.loop.submit(ArmRequest())
    assert flight.loop.action_failure == ""


async def test_silent_mocap_on_the_ground_disarms() -> None:
    mocap = {"silences": [{"start_s": 6.0, "for_s": 100.0}]}
    flight = await fly([*QUICK_ARM, until(Phase.DISARMED)], mocap=mocap)
    assert "no usable pose for 0.2" in flight.loop.flight.reason
    assert Phase.TAKEOFF not in flight.phases()


async def test_a_pilot_who_changes_the_mode_has_the_vehicle() -> None:
    flight = await fly([*QUICK_UP, wait(1.0), command(21), until(Phase.HANDED_OVER), wait(3.0)])
    over_s = flight.loop.flight.since_s
    assert flight.loop.flight.reason == "the autopilot shows mode land, not offboard: Landing at current position"
    assert all(at_s <= over_s for at_s, _ in flight.autopilot.setpoints), "it fought the pilot"
    assert flight.loop.submit(TrackRequest(LAP, 1.0)), "nothing but a new beginning is accepted"


async def test_a_kill_ends_the_flight() -> None:
    # Higher, and it hits the floor before the HEARTBEAT tells of the kill.
    low = [*QUICK_UP[:-1], lambda flight: bool(flight.room.truth_w_m[2] > 0.25)]
    flight = await fly([*low, command(400, 0.0, 21196.0), until(Phase.DISARMED)])
    assert flight.loop.flight.reason == "the autopilot disarmed without our asking: Disarmed by external command"


class _Broken(Pid):
    """A law that fails once it is well in the air."""

    def step(self, memory: object, now: ControlInput) -> tuple[object, ControlOutput]:  # type: ignore[override]
        if now.position_w_m[2] > 0.8:
            raise ZeroDivisionError("a mistake in somebody's law")
        return super().step(memory, now)  # type: ignore[arg-type]


async def test_a_law_that_raises_makes_the_autopilot_land_with_its_vision() -> None:
    flight = await fly(
        [*QUICK_UP[:-1], until(Phase.HANDED_OVER), until(Phase.DISARMED)], controller=_Broken(PidGains())
    )
    assert flight.loop.flight.reason == "the control law failed: ZeroDivisionError: a mistake in somebody's law"
    assert flight.autopilot.land_calls == 1
    drift_m = np.linalg.norm(flight.truths_w_m[-1][:2])
    assert drift_m < 0.3, "vision went on, so the autopilot knew where it was"


async def test_the_last_setpoint_before_handing_over_is_level() -> None:
    flight = await _silenced()
    last = flight.autopilot.setpoints[-1][1]
    assert up_axis(last.q_w_flu_wxyz)[2] == pytest.approx(1.0, abs=1e-9)
    assert 0.4 < float(last.thrust) < 0.5, "a little less than hovering takes"


async def test_handing_over_on_request_lands_although_the_first_command_is_lost() -> None:
    flight = await fly([*QUICK_UP, ask(HandOverRequest("somebody asked")), wait(4.0)], lost_land_commands=1)
    assert flight.autopilot.land_calls == 2
    assert flight.autopilot.status().mode is FlightMode.LAND


async def test_a_jump_of_motion_capture_in_the_air_is_not_followed() -> None:
    jumped: list[bool] = []

    def jump(flight: Flight) -> bool:
        flight.room.offset_w_m = np.array([0.6, 0.0, 0.0])
        jumped.append(True)
        return True

    flight = await fly([*QUICK_UP, wait(1.0), jump, until(Phase.HANDED_OVER), wait(1.0)])
    assert "the pose jumped by 0.60 m" in flight.loop.flight.reason
    assert flight.autopilot.land_calls == 1, "told at once, and once"
    assert flight.autopilot.status().mode is FlightMode.LAND
    assert np.abs(flight.truths_w_m[-1][0]) < 0.2


async def test_an_armed_vehicle_is_not_taken_over() -> None:
    refused: list[bool] = []

    def take_over(flight: Flight) -> bool:
        flight.loop._enter(replace(flight.loop.flight, phase=Phase.STANDBY))
        refused.append(bool(flight.loop.submit(ArmRequest())))
        return True

    flight = await fly([*QUICK_UP, wait(1.0), take_over])
    assert refused == [True]
    assert flight.autopilot.status().armed


async def test_a_listener_that_raises_does_not_stop_the_flight() -> None:
    flight = await fly([*QUICK_UP, wait(1.0), *DOWN], raise_in_sink_at_s=8.0)
    assert flight.phase is Phase.DISARMED
    assert flight.loop.flight.reason == ""


class _NotANumber(Pid):
    """A law that computes NaN for a while."""

    def step(self, memory: object, now: ControlInput) -> tuple[object, ControlOutput]:  # type: ignore[override]
        after, output = super().step(memory, now)  # type: ignore[arg-type]
        bad = 0.6 < now.position_w_m[2] < 0.63
        return after, replace(output, accel_w_mps2=output.accel_w_mps2 * np.nan) if bad else output


class _Lost(Pid):
    """A law whose memory is spoilt for good."""

    def step(self, memory: object, now: ControlInput) -> tuple[object, ControlOutput]:  # type: ignore[override]
        after, output = super().step(memory, now)  # type: ignore[arg-type]
        spoilt = now.position_w_m[2] > 0.6
        return after, replace(output, accel_w_mps2=output.accel_w_mps2 * np.nan) if spoilt else output


async def test_a_law_that_gives_no_number_any_more_is_handed_over() -> None:
    flight = await fly([*QUICK_UP[:-1], until(Phase.HANDED_OVER), wait(1.0)], controller=_Lost(PidGains()))
    assert "no finite command" in flight.loop.flight.reason
    assert flight.autopilot.land_calls == 1


async def test_nan_never_leaves_the_gate() -> None:
    flight = await fly([*QUICK_UP, wait(2.0)], controller=_NotANumber(PidGains()))
    assert any(tick.limited is not None and bool(tick.limited.not_finite) for tick in flight.ticks)
    for _, setpoint in flight.autopilot.setpoints:
        assert np.isfinite(setpoint.q_w_flu_wxyz).all()
        assert np.isfinite(setpoint.thrust)
