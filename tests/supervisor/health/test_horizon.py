"""Judgement of the two horizons: the vehicle's motion tells which one is right."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import Array, Vec3
from companion.geometry.frames import quat_multiply, up_axis_floats
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.attitude import AttitudeHealth, check_attitude
from companion.supervisor.health.horizon import (
    AVERAGED_S,
    MotionMeans,
    angle_between_rad,
    autopilot_horizon_wrong,
    update_means,
)
from companion.supervisor.health_inputs import HealthInputs
from tests.supervisor.observing import (
    CYCLE_S,
    LEVEL,
    RULES,
    faults,
    healthy,
    standing,
    text_of,
    tilted,
    watched,
    with_seen,
    with_status,
    with_vehicle,
)

G = 9.8
UP = (0.0, 0.0, 1.0)
SAID = "the autopilot's horizon is 0.40 rad off: the vehicle moves as motion capture sees it"


def up(q: Array) -> Vec3:
    x, y, z = up_axis_floats(q)
    return x, y, z


def accel_of(q: Array, share: float = 1.0, push_mps2: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """Return the acceleration of a vehicle so tilted whose rotors give this share of its weight, with a push, m/s^2."""
    return np.asarray(share * G * np.array(up(q)) - np.array([0.0, 0.0, G]) + np.array(push_mps2))


def flight(
    ours: Array,
    theirs: Array,
    accel_w_mps2: Array,
    cycles: int = 200,
    start_mps: tuple[float, float, float] = (0, 0, 0),
) -> list[HealthInputs]:
    """In the air, tilted so by motion capture and so by the autopilot, moving so."""
    made = []
    for k in range(cycles):
        velocity = np.array(start_mps, dtype=float) + k * CYCLE_S * accel_w_mps2
        now = with_vehicle(healthy(k), q_w_flu_wxyz=ours, velocity_w_mps=velocity)
        made.append(with_status(now, q_w_flu_wxyz=theirs))
    return made


DISAGREE = {Fault.ATTITUDE_DISAGREES, Fault.HORIZON_WRONG}


def found(observed: list[HealthInputs]) -> list[set[Fault]]:
    return [DISAGREE & set(faults(events)) for events in watched(observed)]


@pytest.mark.parametrize("true", [tilted(-0.4), tilted(0.2, -0.3), tilted(0.0, 0.5, 2.0), tilted(0.1, 0.1)])
@pytest.mark.parametrize("off", [tilted(0.4), tilted(-0.3), tilted(0.0, 0.6), tilted(-0.4, 0.5)])
def test_who_explains_the_motion_is_believed(true: Array, off: Array) -> None:
    lie = quat_multiply(off, true)
    autopilots = found(flight(true, lie, accel_of(true), start_mps=(1.0, -2.0, 0.5)))
    assert autopilots == [{Fault.HORIZON_WRONG} if k >= 32 else set() for k in range(200)]
    ours = found(flight(lie, true, accel_of(true), start_mps=(1.0, -2.0, 0.5)))
    assert ours == [{Fault.ATTITUDE_DISAGREES} if k >= 32 else set() for k in range(200)]


@pytest.mark.parametrize("share", [0.5, 0.7, 1.4])
def test_how_hard_the_rotors_push_does_not_matter(share: float) -> None:
    true = tilted(-0.4)
    assert found(flight(true, LEVEL, accel_of(true, share)))[-1] == {Fault.HORIZON_WRONG}
    assert found(flight(LEVEL, true, accel_of(true, share)))[-1] == {Fault.ATTITUDE_DISAGREES}


@pytest.mark.parametrize("angle_rad", np.linspace(0.0, 6.0, 7).tolist())
def test_a_push_of_a_few_newtons_hides_no_lie_and_makes_none(angle_rad: float) -> None:
    push = 1.0 * math.cos(angle_rad), 1.0 * math.sin(angle_rad), 0.0
    true = tilted(-0.3)
    assert found(flight(true, LEVEL, accel_of(true, 1.0, push)))[-1] == {Fault.HORIZON_WRONG}
    assert found(flight(LEVEL, true, accel_of(true, 1.0, push)))[-1] == {Fault.ATTITUDE_DISAGREES}


def test_where_nobody_can_tell_the_autopilot_is_not_accused() -> None:
    between, falls = accel_of(tilted(-0.2)), np.array([0.0, 0.0, -G])
    assert found(flight(tilted(-0.4), LEVEL, between))[-1] == {Fault.ATTITUDE_DISAGREES}, "pushed, but by whom"
    assert found(flight(tilted(-0.4), LEVEL, falls))[-1] == {Fault.ATTITUDE_DISAGREES}, "it falls"
    standing_still = [standing(now) for now in flight(tilted(-0.4), LEVEL, accel_of(tilted(-0.4)))]
    assert found(standing_still)[-1] == {Fault.ATTITUDE_DISAGREES}, "the ground pushes, too"


def test_with_another_heading_the_tilts_in_the_world_say_nothing() -> None:
    true = tilted(-0.4)
    for heading_rad, fault in ((0.374, Fault.HORIZON_WRONG), (0.376, Fault.ATTITUDE_DISAGREES)):
        turned = found(flight(true, tilted(0.0, 0.0, heading_rad), accel_of(true)))
        assert turned[-1] == {fault}


def test_in_words() -> None:
    events = watched(flight(tilted(-0.4), LEVEL, accel_of(tilted(-0.4))))[-1]
    assert text_of(events, Fault.HORIZON_WRONG) == SAID


def test_once_it_has_lied_it_is_not_believed_until_both_agree() -> None:
    """Prove nothing by what bumps into it meanwhile, and judge the next lie anew."""
    true = tilted(-0.4)
    lies = flight(true, LEVEL, accel_of(true), 40)
    rests = flight(true, LEVEL, np.zeros(3), 200)
    assert found([*lies, *rests[40:120]]) == [*[set()] * 32, *[{Fault.HORIZON_WRONG}] * 88]
    agree = with_status(rests[120], q_w_flu_wxyz=true)
    assert found([*lies, *rests[40:120], agree, *rests[121:]])[-1] == {Fault.ATTITUDE_DISAGREES}


def test_its_own_horizon_is_what_setpoints_are_executed_by() -> None:
    """Level is asked for, and level is what it believes to be: followed, although it hangs askew."""
    true = tilted(-0.4)
    lies = flight(true, LEVEL, accel_of(true), 300)
    assert not [1 for events in watched(lies) if Fault.SETPOINT_NOT_FOLLOWED in faults(events)]
    turns = [with_status(now, q_w_flu_wxyz=tilted(0.8)) for now in lies[150:]]
    events = watched([*lies[:150], *turns])[-1]
    assert text_of(events, Fault.SETPOINT_NOT_FOLLOWED).startswith("the tilt is 0.80 rad off")


def test_means_begin_anew_where_tilts_cannot_be_compared() -> None:
    now = flight(tilted(-0.4), LEVEL, np.zeros(3), 2)
    memory, _ = check_attitude(AttitudeHealth(), now[0], RULES)
    assert memory.means is not None
    for gone in (with_seen(now[1], age_s=1.0), with_status(now[1], attitude_s=0.0), standing(now[1])):
        assert check_attitude(memory, gone, RULES)[0].means is None


def test_the_means_are_of_the_first_order() -> None:
    """Against their closed form, at uneven times."""
    pushed, at_s, slope = None, 3.0, np.array([1.0, -2.0, 3.0])
    ours, theirs = (0.6, 0.0, 0.8), (0.0, -0.6, 0.8)
    for passed_s in (0.0, 0.01, 0.05, 0.02, 0.3):
        at_s += passed_s
        pushed = update_means(pushed, at_s, 7.0 + slope * at_s, ours, theirs)
    assert pushed is not None
    grown = 1.0 - math.exp(-0.38 / AVERAGED_S)
    assert pushed.force_mps2 == pytest.approx((grown * 1.0, grown * -2.0, grown * (3.0 + G)))
    assert pushed.ours == pytest.approx(grown * np.array(ours))
    assert pushed.theirs == pytest.approx(grown * np.array(theirs))
    assert (pushed.at_s, pushed.velocity_mps) == (at_s, tuple((7.0 + slope * at_s).tolist()))


def test_a_capture_is_counted_once() -> None:
    first = update_means(None, 3.0, np.zeros(3), UP, UP)
    assert first == MotionMeans(3.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert update_means(first, 3.0, np.ones(3), UP, UP) is first
    assert update_means(first, 2.0, np.ones(3), UP, UP) is first
    assert update_means(first, math.nan, np.ones(3), UP, UP) is first


def test_the_force_must_be_nearer_to_motion_captures_axis() -> None:
    def lies(force_rad: float, size: float = 9.8) -> bool:
        force = size * math.sin(force_rad), 0.0, size * math.cos(force_rad)
        return autopilot_horizon_wrong(MotionMeans(0.0, UP, force, UP, (math.sin(0.5), 0.0, math.cos(0.5))))

    assert lies(0.199)
    assert not lies(0.201)
    assert lies(-0.199)
    assert not lies(-0.201)
    assert lies(0.0, 4.01)
    assert not lies(0.0, 4.0)
    assert not autopilot_horizon_wrong(None)
    assert not lies(math.nan)


def test_the_angle_between() -> None:
    assert angle_between_rad(UP, (0.0, 0.0, 5.0)) == 0.0
    assert angle_between_rad(UP, (0.0, 2.0, 2.0)) == pytest.approx(0.25 * math.pi)
    assert angle_between_rad(UP, (0.0, 0.0, -1.0)) == pytest.approx(math.pi)
    assert angle_between_rad((1.0, 2.0, 3.0), (-3.0, 1.0, 2.0)) == pytest.approx(math.acos(5.0 / 14.0))


NEAR = {"position_w_m": np.array([3.9, 0.0, 1.0]), "velocity_w_mps": np.array([1.0, 0.0, 0.0])}
LEFT = {"position_w_m": np.array([4.1, 0.0, 1.0]), "velocity_w_mps": np.zeros(3)}


@pytest.mark.parametrize(
    ("where", "fault", "text"),
    [
        (NEAR, Fault.FENCE_NEAR, "0.10 m inside the fence and too fast to stop there"),
        (LEFT, Fault.FENCE_LEFT, "0.10 m outside the fence"),
    ],
)
def test_at_the_fence_a_wrong_horizon_is_the_end(where: dict[str, Array], fault: Fault, text: str) -> None:
    true = tilted(-0.4)
    lies = flight(true, LEVEL, accel_of(true), 40)
    at_fence = with_vehicle(lies[-1], **where)
    events = watched([*lies[:-1], at_fence])[-1]
    assert Event(Fault.HORIZON_LOST, f"{text}, by a wrong horizon") in events
    assert text_of(events, fault) == text
    honest = [with_status(now, q_w_flu_wxyz=true) for now in [*lies[:-1], at_fence]]
    assert Fault.HORIZON_LOST not in faults(watched(honest)[-1])


def test_what_px4_would_land_for_our_landing_goes_on_with() -> None:
    true = tilted(-0.4)
    lies = [with_status(now, battery_fraction=0.1) for now in flight(true, LEVEL, accel_of(true), 100)]
    far = [replace(now, reference_w_m=np.array([0.5, 1.0, 1.0])) for now in lies]
    events = watched(far)[-1]
    assert faults(events) == [Fault.HORIZON_WRONG, Fault.TRACKING_ERROR, Fault.BATTERY_LOW]
    assert text_of(events, Fault.TRACKING_ERROR) == "1.25 m from the reference"
    assert text_of(events, Fault.BATTERY_LOW).endswith("below 12 %")
    honest = watched([with_status(now, q_w_flu_wxyz=true) for now in far])[-1]
    assert {Fault.TRACKING_LOST, Fault.BATTERY_CRITICAL} <= set(faults(honest))
