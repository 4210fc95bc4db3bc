"""Flight between the phases: no step in the reference, short stops, landings that end."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.safety_config import FenceConfig
from companion.core.types import Reference
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import (
    Action,
    FlightInputs,
    FlightRules,
    FlightState,
    HoldRequest,
    LandRequest,
    Leg,
    Phase,
    TakeoffRequest,
    TrackRequest,
)
from companion.supervisor.state_machine import advance, reference_at
from companion.trajectories.reference import Ellipse, FigureEight, Hold, MinimumJerk, Trajectory
from tests.supervisor.flown import (
    CENTRE,
    CURVE,
    DT_S,
    GROUND,
    IN_THE_AIR,
    RULES,
    STATES,
    apply_request,
    approaching,
    armed,
    descending,
    facts,
    on_reference,
    until,
    with_faults,
)

BROKEN = "left.elbow_pitch (servo 6): overload"


def check_continuous(flight: FlightState, from_s: float, for_s: float) -> None:
    """No step in position or velocity over all legs, including the ends."""
    h = 0.01
    times = np.arange(from_s, from_s + for_s, h)
    p = np.array([reference_at(flight, float(t)).position_w_m for t in times])
    v = np.array([reference_at(flight, float(t)).velocity_w_mps for t in times])
    assert float(np.abs(np.diff(p, axis=0)).max()) < 2.0 * h * 1.5
    assert float(np.abs(np.diff(v, axis=0)).max()) < 2.0 * h * 4.0
    np.testing.assert_allclose((p[2:] - p[:-2]) / (2 * h), v[1:-1], atol=0.02)


def check_taken_over(before: Reference, after: Reference, acceleration: bool = True) -> None:
    np.testing.assert_allclose(after.position_w_m, before.position_w_m, atol=1e-9)
    np.testing.assert_allclose(after.velocity_w_mps, before.velocity_w_mps, atol=1e-9)
    if acceleration:
        np.testing.assert_allclose(after.acceleration_w_mps2, before.acceleration_w_mps2, atol=1e-9)
    assert after.yaw_rad == pytest.approx(before.yaw_rad)


# --- flying ---


@pytest.mark.parametrize("trajectory", [CURVE, FigureEight(CENTRE)], ids=["ellipse", "eight"])
@pytest.mark.parametrize("state", ["hovering", "approaching", "tracking", "held by a fault"])
def test_the_reference_is_continuous_over_the_legs(state: str, trajectory: Trajectory) -> None:
    flight, time_s = STATES[state]
    flown = apply_request(flight, TrackRequest(trajectory, 1.0), on_reference(flight, time_s), RULES)
    check_taken_over(reference_at(flight, time_s), reference_at(flown, time_s))
    check_continuous(flown, time_s, sum(min(leg.trajectory.duration_s, 40.0) for leg in flown.legs) + 1.0)


def test_the_way_to_a_trajectory_waits_there_and_the_end_is_held() -> None:
    flight, time_s = STATES["hovering"]
    trajectory = Ellipse(CENTRE, yaw_rad=0.5)
    flown = apply_request(flight, TrackRequest(trajectory, 2.5), on_reference(flight, time_s), RULES)
    way, wait, curve, rest = flown.legs
    assert [leg.phase for leg in flown.legs] == [Phase.HOLD, Phase.HOLD, Phase.TRACK, Phase.HOLD]
    assert (wait.trajectory.duration_s, curve.trajectory) == (2.5, trajectory)
    begin, end = trajectory.at(0.0), trajectory.at(trajectory.duration_s)
    for leg, place in ((wait, begin), (rest, end)):
        np.testing.assert_array_equal(leg.trajectory.at(1.0).position_w_m, place.position_w_m)
        assert leg.trajectory.at(1.0).yaw_rad == place.yaw_rad == 0.5
    speeds = [np.linalg.norm(way.trajectory.at(0.01 * n).velocity_w_mps) for n in range(1000)]
    assert max(speeds) == pytest.approx(RULES.climb_speed_mps, rel=1e-3), "as fast as it climbs, no faster"


@pytest.mark.parametrize(
    ("from_rad", "to_rad", "way_rad"), [(0.3, 0.3 + 3.0, 3.0), (-2.0, 2.0, 2.0 * np.pi - 4.0), (1.0, 1.0, 0.0)]
)
@pytest.mark.parametrize("turn_radps", [1.0, 0.5])
def test_a_turn_takes_its_time_the_short_way(from_rad: float, to_rad: float, way_rad: float, turn_radps: float) -> None:
    flight, time_s = STATES["hovering"]
    here = reference_at(flight, time_s).position_w_m
    flight = replace(flight, legs=(Leg(Phase.HOLD, Hold(here, from_rad)),))
    rules = replace(RULES, turn_radps=turn_radps)
    flown = apply_request(flight, TrackRequest(Hold(here, to_rad, 5.0), 1.0), on_reference(flight, time_s), rules)
    assert flown.legs[0].trajectory.duration_s == pytest.approx(max(1.0, 1.875 * way_rad / turn_radps))


def test_a_small_turn_is_not_begun_with_a_jerk() -> None:
    flight, time_s = STATES["hovering"]
    here = reference_at(flight, time_s).position_w_m
    flight = replace(flight, legs=(Leg(Phase.HOLD, Hold(here, 0.0)),))
    way = (
        apply_request(flight, TrackRequest(Hold(here, 0.5, 5.0), 1.0), on_reference(flight, time_s), RULES)
        .legs[0]
        .trajectory
    )
    turned = np.array([way.at(0.01 * n).yaw_rad for n in range(300)])
    accels = np.abs(np.diff(turned, n=2)) / 1e-4
    assert accels.max() == pytest.approx(RULES.turn_accel_radps2, rel=0.01)


@pytest.mark.parametrize(
    "order", [HoldRequest(), LandRequest(), TrackRequest(Hold(GROUND + np.array([0.0, 0.0, 1.0]), -1.0), 1.0)]
)
def test_a_heading_that_turns_comes_to_rest_as_the_place_does(order: HoldRequest | LandRequest | TrackRequest) -> None:
    flight, time_s = STATES["hovering"]
    here = reference_at(flight, time_s).position_w_m
    turning = MinimumJerk(start_w_m=here, end_w_m=here, duration_s=4.0, start_yaw_rad=3.0, end_yaw_rad=3.0 + 2.0)
    flight = replace(flight, legs=(Leg(Phase.TRACK, turning),), leg_start_s=time_s - 2.0)
    before = np.array([reference_at(flight, time_s - 0.01 * n).yaw_rad for n in (2, 1, 0)])
    flown = apply_request(flight, order, on_reference(flight, time_s), RULES)
    after = np.array([reference_at(flown, time_s + 0.01 * n).yaw_rad for n in range(1, 800)])
    rates = np.diff(np.unwrap(np.concatenate((before, after)))) / 0.01
    assert rates[0] == pytest.approx(1.875 * 2.0 / 4.0, rel=0.01), "it turned"
    assert np.abs(np.diff(rates)).max() < 0.03, "3 rad/s^2 at the most"
    assert rates[-1] == pytest.approx(0.0, abs=1e-9)


def test_a_vehicle_in_motion_is_given_room_to_turn_round() -> None:
    """Straight back from 0.5 m/s, to where it is now: within the acceleration of a climb."""
    flight, time_s = STATES["hovering"]
    here, speed = GROUND + np.array([0.0, 0.0, 1.2]), np.array([0.5, 0.0, 0.0])
    moving = MinimumJerk(
        start_w_m=here,
        end_w_m=here + 5.0 * speed,
        duration_s=10.0,
        start_yaw_rad=0.0,
        end_yaw_rad=0.0,
        start_velocity_w_mps=speed,
    )
    flight = replace(flight, legs=(Leg(Phase.TRACK, moving),), leg_start_s=time_s)
    flown = apply_request(flight, TrackRequest(Hold(here, 0.0, 5.0), 1.0), on_reference(flight, time_s), RULES)
    way = flown.legs[0].trajectory
    pushes = [np.linalg.norm(way.at(0.01 * n).acceleration_w_mps2) for n in range(int(100 * way.duration_s))]
    assert 0.9 * RULES.climb_accel_mps2 < max(pushes) <= RULES.climb_accel_mps2


@settings(max_examples=10)
@given(late_s=st.floats(0.0, 60.0))
def test_a_late_tick_does_not_shift_the_reference(late_s: float) -> None:
    """Legs begin when the last one ended, not when somebody looked."""
    flight, time_s = approaching()
    seen_s = time_s + late_s
    expected = reference_at(flight, seen_s)
    for _ in range(5):
        flight = advance(flight, facts(seen_s, 1.0), RULES)
    np.testing.assert_array_equal(reference_at(flight, seen_s).position_w_m, expected.position_w_m)


def test_a_trajectory_ends_where_it_ends() -> None:
    flight, time_s = until(*STATES["tracking"], lambda now: now.phase is Phase.HOLD)
    end = CURVE.at(CURVE.duration_s).position_w_m
    np.testing.assert_allclose(reference_at(flight, time_s).position_w_m, end, atol=1e-9)


def test_a_leg_begins_at_the_very_end_of_the_last() -> None:
    flight, time_s = STATES["hovering"]
    start = Hold(GROUND, 0.0, 2.0)
    flight = replace(flight, legs=(Leg(Phase.HOLD, start), Leg(Phase.TRACK, CURVE)), leg_start_s=time_s)
    assert advance(flight, facts(time_s + 1.999, 1.0), RULES).phase is Phase.HOLD
    after = advance(flight, facts(time_s + 2.0, 1.0), RULES)
    assert (after.phase, after.leg_start_s, after.since_s) == (Phase.TRACK, time_s + 2.0, time_s + 2.0)
    np.testing.assert_array_equal(reference_at(flight, time_s + 2.0).position_w_m, CURVE.at(0.0).position_w_m)


# --- taking off ---


def test_take_off_ends_above_where_it_stood() -> None:
    flight, time_s = STATES["hovering"]
    np.testing.assert_allclose(reference_at(flight, time_s).position_w_m, GROUND + np.array([0.0, 0.0, 1.2]))
    assert reference_at(flight, time_s).yaw_rad == flight.yaw_rad == 0.3


def test_the_climb_begins_where_the_vehicle_left_the_ground() -> None:
    spooling = apply_request(armed(), TakeoffRequest(1.0), facts(1.0), RULES)
    drifted = replace(facts(2.5, 0.03, climb_mps=0.2), position_w_m=GROUND + np.array([0.1, -0.2, 0.03]))
    climbing = advance(replace(spooling, yaw_rad=0.4), drifted, RULES)
    np.testing.assert_array_equal(reference_at(climbing, 2.5).position_w_m, drifted.position_w_m)
    heights_m = [reference_at(climbing, 2.5 + 0.01 * n).position_w_m[2] for n in range(600)]
    assert float(np.max(np.diff(heights_m))) / 0.01 <= RULES.climb_speed_mps * 1.001
    np.testing.assert_allclose(reference_at(climbing, 9.0).position_w_m, GROUND + np.array([0.0, 0.0, 1.0]))
    assert {reference_at(climbing, 2.5 + at_s).yaw_rad for at_s in (0.0, 1.0, 6.0)} == {0.4}
    assert [leg.phase for leg in climbing.legs] == [Phase.TAKEOFF, Phase.HOLD]


# --- stopping ---


@pytest.mark.parametrize("wanted", [HoldRequest(), None], ids=["asked", "fault"])
@pytest.mark.parametrize("state", ["climbing", "hovering", "approaching", "tracking"])
def test_a_stop_takes_over_the_motion_and_rests(state: str, wanted: HoldRequest | None) -> None:
    flight, time_s = STATES[state]
    seen = on_reference(flight, time_s)
    stopped = (
        apply_request(flight, wanted, seen, RULES)
        if wanted
        else advance(flight, with_faults(seen, Fault.FENCE_NEAR), RULES)
    )
    assert (stopped.phase, stopped.since_s, stopped.leg_start_s) == (Phase.HOLD, time_s, time_s)
    assert stopped.level is (FailsafeAction.WARN if wanted else FailsafeAction.HOLD)
    check_taken_over(reference_at(flight, time_s), reference_at(stopped, time_s))
    check_continuous(stopped, time_s, 5.0)
    rest = reference_at(stopped, time_s + 5.0)
    np.testing.assert_array_equal(rest.velocity_w_mps, np.zeros(3))
    assert rest.yaw_rad == reference_at(flight, time_s).yaw_rad
    assert {leg.phase for leg in stopped.legs} == {Phase.HOLD}
    assert advance(stopped, on_reference(stopped, time_s + 5.0), RULES).phase is Phase.HOLD


@pytest.mark.parametrize("speed_mps", [0.2, 0.5, 1.0, 2.0])
def test_a_stop_ends_where_the_fence_counts_on_it(speed_mps: float) -> None:
    """A fence that is near is answered with a stop: it must not lead out of it."""
    flight, time_s = STATES["tracking"]
    velocity = np.array([speed_mps, 0.0, 0.0])
    flight = replace(flight, legs=(Leg(Phase.TRACK, _Straight(CENTRE, velocity)),), leg_start_s=time_s)
    stopped = advance(flight, with_faults(on_reference(flight, time_s), Fault.FENCE_NEAR), RULES)
    place = reference_at(stopped, time_s + 5.0).position_w_m
    counted_on = FenceConfig().fence().stopping_point_w_m(CENTRE, velocity)[0]
    assert place[0] <= counted_on + 0.011
    pushes = [np.linalg.norm(reference_at(stopped, time_s + 0.01 * n).acceleration_w_mps2) for n in range(100 * 5)]
    assert max(pushes) <= RULES.braking_mps2 * 1.001


class _Straight:
    """On and on."""

    duration_s = float("inf")

    def __init__(self, start_w_m: np.ndarray, velocity_w_mps: np.ndarray) -> None:
        self._start_w_m, self._velocity_w_mps = start_w_m, velocity_w_mps

    def at(self, time_s: float) -> Reference:
        return Reference(self._start_w_m + time_s * self._velocity_w_mps, self._velocity_w_mps, np.zeros(3), 0.0)


# --- landing ---


@pytest.mark.parametrize("state", IN_THE_AIR)
def test_landing_takes_over_the_motion(state: str) -> None:
    flight, time_s = STATES[state]
    down = apply_request(flight, LandRequest(), on_reference(flight, time_s), RULES)
    assert {leg.phase for leg in down.legs} == {down.phase}
    check_taken_over(reference_at(flight, time_s), reference_at(down, time_s), acceleration=False)
    check_continuous(down, time_s, 5.0)


def test_a_landing_says_when_it_should_be_over() -> None:
    flight, time_s = STATES["descending"]
    assert flight.landing_due_s == pytest.approx(time_s + 1.2 / RULES.descent_speed_mps)
    assert STATES["stowing"][0].landing_due_s == float("inf")
    assert STATES["hovering"][0].landing_due_s == float("inf")
    below = replace(STATES["hovering"][0], ground_w_m=GROUND + np.array([0.0, 0.0, 2.0]))
    assert apply_request(below, LandRequest(), facts(9.0), RULES).landing_due_s == pytest.approx(9.0 + 0.8 / 0.25)
    unknown = replace(STATES["hovering"][0], ground_w_m=None)
    assert apply_request(unknown, LandRequest(), facts(9.0), RULES).landing_due_s == pytest.approx(9.0 + 1.3 / 0.25)
    down, down_s = STATES["touched down"]
    over = advance(down, facts(down_s + DT_S, armed=False), RULES)
    assert (over.phase, over.landing_due_s) == (Phase.DISARMED, float("inf"))  # it is not overdue for ever after


@pytest.mark.parametrize("ask", [True, False], ids=["asked", "fault"])
@pytest.mark.parametrize("state", ["climbing", "hovering", "tracking", "held by a fault"])
def test_arms_are_folded_first(state: str, ask: bool) -> None:
    flight, time_s = STATES[state]
    hanging = replace(on_reference(flight, time_s), arms_stowed=False)
    stowing = (
        apply_request(flight, LandRequest(), hanging, RULES)
        if ask
        else advance(flight, with_faults(hanging, Fault.BATTERY_LOW), RULES)
    )
    assert (stowing.phase, stowing.airborne) == (Phase.STOW, True)
    assert {leg.phase for leg in stowing.legs} == {Phase.STOW}
    check_taken_over(reference_at(flight, time_s), reference_at(stowing, time_s))


@pytest.mark.parametrize("ask", [True, False], ids=["asked", "fault"])
@pytest.mark.parametrize("state", ["climbing", "hovering", "approaching", "tracking", "held by a fault", "stowing"])
def test_broken_arms_are_not_folded(state: str, ask: bool) -> None:
    """In STOW the table has nothing more to say: the waiting ends."""
    flight, time_s = STATES[state]
    broken = replace(on_reference(flight, time_s), arms_stowed=False, arm_fault=BROKEN)
    after = apply_request(flight, LandRequest(), broken, RULES) if ask else flight
    after = advance(after, with_faults(broken, Fault.ARMS), RULES)
    assert (after.phase, after.airborne) == (Phase.LAND, True)
    check_taken_over(reference_at(flight, time_s), reference_at(after, time_s), acceleration=False)


@pytest.mark.parametrize("state", ["climbing", "hovering", "tracking"])
def test_an_arm_fault_may_be_told_not_to_end_the_flight(state: str) -> None:
    flight, time_s = STATES[state]
    broken = replace(on_reference(flight, time_s), arm_fault=BROKEN)
    noted = replace(RULES, land_on_arm_fault=False)
    both = with_faults(broken, Fault.ARMS, Fault.OPERATOR_GONE)
    assert advance(flight, both, noted).phase is flight.phase
    weak = with_faults(broken, Fault.ARMS, Fault.FENCE_NEAR)
    assert advance(flight, weak, noted).cause is Fault.FENCE_NEAR, "what else is wrong still counts"
    assert advance(flight, weak, RULES).cause is Fault.ARMS


def _stowing_at(later_s: float) -> tuple[FlightState, FlightInputs]:
    flight, time_s = STATES["stowing"]
    return flight, replace(on_reference(flight, time_s + later_s), arms_stowed=False)


def test_landing_waits_at_rest_until_the_arms_are_stowed() -> None:
    flight, time_s = STATES["stowing"]
    while time_s < flight.since_s + 4.0:
        time_s += DT_S
        flight = advance(flight, replace(on_reference(flight, time_s), arms_stowed=False), RULES)
    assert (flight.phase, len(flight.legs)) == (Phase.STOW, 1)
    np.testing.assert_allclose(reference_at(flight, time_s).velocity_w_mps, np.zeros(3))
    landing = advance(flight, on_reference(flight, time_s + DT_S), RULES)
    assert (landing.phase, landing.reason) == (Phase.LAND, "")


@pytest.mark.parametrize(
    ("later_s", "change", "phase", "reason"),
    [
        (6.0, {}, Phase.STOW, ""),
        (6.01, {}, Phase.LAND, "the arms were not stowed in time"),
        (6.01, {"arms_stowed": True}, Phase.LAND, ""),
        (1.0, {"cannot_stow": "a cable"}, Phase.LAND, "a cable"),
        (6.01, {"cannot_stow": "a cable"}, Phase.LAND, "a cable"),
        (6.01, {"arm_fault": BROKEN, "cannot_stow": "a cable"}, Phase.LAND, BROKEN),
        (1.0, {"arm_fault": BROKEN}, Phase.LAND, BROKEN),
    ],
)
def test_what_ends_the_waiting_for_the_arms(later_s: float, change: dict[str, str], phase: Phase, reason: str) -> None:
    flight, seen = _stowing_at(later_s)
    after = advance(flight, replace(seen, **change), RULES)  # type: ignore[arg-type]
    assert (after.phase, after.reason) == (phase, reason)
    low = replace(flight, reason="battery low")
    assert advance(low, replace(seen, **change), RULES).reason == "battery low"  # type: ignore[arg-type]


# --- touchdown ---


@pytest.mark.parametrize("rules", [RULES, replace(RULES, disarm_wait_unknown_s=2.0)])
def test_touchdown_asks_to_disarm_and_again_when_it_stays_armed(rules: FlightRules) -> None:
    flight, time_s = STATES["touched down"]
    assert (flight.phase, flight.airborne, flight.still_since_s, flight.yaw_rad) == (Phase.LAND, False, None, 0.3)
    asked_s = []
    for n in range(1, 2700):
        flight = advance(flight, facts(time_s + n * DT_S), rules)
        asked_s += [n * DT_S] if flight.action is Action.DISARM else []
    first_s = rules.disarm_wait_unknown_s
    again_s = [first_s + k * rules.disarm_again_s for k in range(1 + int((26.9 - first_s) / rules.disarm_again_s))]
    assert asked_s == pytest.approx(again_s, abs=4 * DT_S)
    over = advance(flight, facts(time_s + 30.0, armed=False), rules)
    assert (over.phase, over.reason) == (Phase.DISARMED, "")


@pytest.mark.parametrize(
    ("height_m", "climb_mps", "because"),
    [(0.07, 0.0, "too high"), (0.0, -0.07, "still falling"), (0.0, 0.07, "bouncing up")],
)
def test_what_is_not_low_and_slow_is_no_touchdown(height_m: float, climb_mps: float, because: str) -> None:
    flight, time_s = descending()
    while reference_at(flight, time_s).position_w_m[2] > GROUND[2] + height_m - RULES.stuck_below_m:
        time_s += DT_S
        flight = advance(flight, facts(time_s, height_m, climb_mps=climb_mps), RULES)
    assert not flight.touched_down, because


@pytest.mark.parametrize(("height_m", "climb_mps"), [(0.055, 0.055), (0.0, -0.055)])
def test_low_and_slow_is_a_touchdown_once_the_reference_is_below(height_m: float, climb_mps: float) -> None:
    flight, time_s = descending()
    below_s = None
    while not flight.touched_down:
        time_s += DT_S
        seen = replace(facts(time_s, height_m, climb_mps=climb_mps), yaw_rad=0.9)
        flight = advance(flight, seen, RULES)
        if below_s is None and reference_at(flight, time_s).position_w_m[2] < GROUND[2] + height_m:
            below_s = time_s
    assert below_s is not None
    assert time_s - below_s == pytest.approx(RULES.touchdown_s, abs=2.5 * DT_S)
    assert (flight.since_s, flight.still_since_s, flight.yaw_rad, flight.airborne) == (time_s, None, 0.9, False)


@pytest.mark.parametrize("state", ["stowing"])
def test_a_landing_far_from_the_start_ends_too(state: str) -> None:
    flight, time_s = STATES[state]
    flight = advance(flight, on_reference(flight, time_s + DT_S), RULES)
    flight, _ = until(flight, time_s + DT_S, lambda now: now.touched_down)
    assert flight.phase is Phase.LAND


@pytest.mark.parametrize("sign", [{"thrust": 0.349}, {"in_air": False}, {"in_air": False, "thrust": 0.5}])
def test_who_stands_on_hanging_arms_or_a_crate_has_landed_too(sign: dict[str, float]) -> None:
    """The thrust is wound down, or the autopilot's own land detector says so."""
    flight, time_s = descending()
    begun_s = time_s
    while not flight.touched_down:
        time_s += DT_S
        assert time_s < begun_s + 20.0, "the motors would run for ever"
        reference = reference_at(flight, time_s).position_w_m[2] - GROUND[2]
        seen = replace(facts(time_s, max(0.35, float(reference))), **sign)  # type: ignore[arg-type]
        flight = advance(flight, seen, RULES)
    below_m = 0.35 - float(reference_at(flight, time_s).position_w_m[2] - GROUND[2])
    assert below_m == pytest.approx(RULES.stuck_below_m + RULES.stuck_s * RULES.descent_speed_mps, abs=0.02)


@pytest.mark.parametrize("thrust", [0.35, 0.5, 0.8, float("nan")])
@pytest.mark.parametrize(("height_m", "in_air"), [(0.07, True), (0.35, None), (1.2, None), (3.5, True)])
def test_who_stays_up_by_his_thrust_has_not_landed_however_far_the_reference_is_below(
    height_m: float, thrust: float, in_air: bool | None
) -> None:
    """A law that does not come down: its rotors carry it, so they must go on, whether or not the autopilot says so."""
    flight, time_s = descending()
    for n in range(2000):
        seen = replace(facts(time_s + n * DT_S, height_m), thrust=thrust, in_air=in_air)
        flight = advance(flight, seen, RULES)
        assert flight.airborne
        assert flight.still_since_s is None, "nor does it look so"


@pytest.mark.parametrize("climb_mps", [-0.07, 0.07])
def test_who_moves_is_not_standing_however_far_the_reference_is_below(climb_mps: float) -> None:
    flight, time_s = descending()
    for n in range(2000):
        seen = replace(facts(time_s + n * DT_S, 0.3, climb_mps=climb_mps), thrust=0.1, in_air=False)
        flight = advance(flight, seen, RULES)
    assert not flight.touched_down


def test_low_and_slow_is_no_touchdown_while_the_reference_is_still_above() -> None:
    """The vehicle is asked to be higher than it is: it will climb, so the motors must go on."""
    flight, time_s = descending()
    for n in range(100):  # the reference is still more than 0.9 m up
        flight = advance(flight, facts(time_s + n * DT_S, 0.0), RULES)
    assert not flight.touched_down


def test_a_landing_that_is_disturbed_begins_to_wait_anew() -> None:
    flight, time_s = descending()
    time_s += 20.0  # the reference is far below the ground by now
    for n in range(200):
        bump = 0.2 if n % 25 == 0 else 0.0
        flight = advance(flight, facts(time_s + n * DT_S, climb_mps=bump), RULES)
    assert not flight.touched_down, "0.25 s of rest at a time is less than touchdown_s"
