"""Law, conversion and gate together: what goes out between events, at lift-off and when the heading turns."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from companion.config.controller_config import load_controller
from companion.control.controller import ControlInput, ControlOutput, VehicleModel
from companion.control.pipeline import YAW_STEP_RAD, ControlPipeline, changed, idle_setpoint, same_setpoint
from companion.core.types import Array, AttitudeThrust, Reference, VehicleState
from companion.geometry.attitude import ThrustModel
from companion.geometry.frames import flip_quat, flip_yz, quat_from_rotation_vector
from companion.guard.geofence import Fence
from companion.guard.guard import AgeRange, Guard
from companion.guard.limits import Limits
from companion.trajectories.reference import Ellipse, LapTiming, MinimumJerk, Trajectory
from mock_autopilot.physics import plant, plant_one
from mock_autopilot.physics.plant import Actuation, PlantParams

LIMITS = Limits()
DT_S = 0.01
SENT = idle_setpoint(0.0, 0.5)
"""The setpoint last sent."""
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
VEHICLE = VehicleState(0.0, np.zeros(3), np.zeros(3), LEVEL, np.zeros(3))


@dataclass
class Script:
    """A law that asks for what the test says, when it says."""

    accel: Array = field(default_factory=lambda: np.zeros(3))
    event: float = 0.0
    preview_s: float = 0.07
    seen: list[ControlInput] = field(default_factory=list)
    begun: int = 0

    def initial(self, first: ControlInput) -> Any:  # noqa: ARG002
        self.begun += 1
        return 0

    def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:
        self.seen.append(now)
        return memory + 1, ControlOutput(self.accel.copy(), np.array([self.event]), {"cycle": np.array(memory)})


def reference(yaw_rad: float = 0.0) -> Reference:
    return Reference(np.zeros(3), np.zeros(3), np.zeros(3), yaw_rad)


def stage_of(law: Script) -> ControlPipeline:
    stage = ControlPipeline(law, ThrustModel(), LIMITS)
    law.seen.clear()
    law.begun = 0
    return stage


def pitch_of(setpoint: AttitudeThrust) -> float:
    """Lean towards +x of a level heading 0 attitude (rad)."""
    return 2.0 * math.atan2(float(setpoint.q_w_flu_wxyz[2]), float(setpoint.q_w_flu_wxyz[0]))


def test_the_law_sees_what_was_really_sent_not_what_it_asked_for() -> None:
    law = Script(np.array([9.0, 0.0, 0.0]), event=1.0)
    stage = stage_of(law)
    asked = stage.fly(VEHICLE, 0.012, reference(), SENT, DT_S)
    stage.fly(VEHICLE, 0.012, reference(), asked.limited.setpoint, DT_S)
    np.testing.assert_allclose(law.seen[0].sent_accel_w_mps2, np.zeros(3), atol=1e-12)
    # cut to 0.06 rad in 10 ms, and thrust 0.5 -> 0.55: f = 0.55/0.5 m g along an axis that leans by 0.06 rad
    push = 1.1 * 9.8
    expected = [push * math.sin(0.06), 0.0, push * math.cos(0.06) - 9.8]
    np.testing.assert_allclose(law.seen[1].sent_accel_w_mps2, expected, atol=1e-9)
    assert law.seen[0].age_s == 0.012
    assert law.seen[0].dt_s == DT_S
    assert stage.preview_s == 0.07


def test_what_counters_the_arms_is_not_told_as_something_that_moves_the_vehicle() -> None:
    law, arms_mps2 = Script(np.array([0.2, -0.1, 0.3]), event=1.0), np.array([0.15, 0.0, -0.1])
    stage = stage_of(law)
    sent = stage.fly(VEHICLE, 0.012, reference(), SENT, DT_S, arms_mps2).limited.setpoint
    stage.fly(VEHICLE, 0.012, reference(), sent, DT_S, 2.0 * arms_mps2)
    np.testing.assert_allclose(law.seen[1].known_accel_w_mps2, 2.0 * arms_mps2)
    np.testing.assert_allclose(law.seen[1].sent_accel_w_mps2, law.accel + arms_mps2, atol=1e-9)
    stage.forget()
    stage.fly(VEHICLE, 0.012, reference(), sent, DT_S)
    np.testing.assert_allclose(law.seen[2].sent_accel_w_mps2, law.accel, atol=1e-9)


def test_between_events_the_setpoint_stays_and_the_gate_goes_on_towards_it() -> None:
    law = Script(np.array([3.0, 0.0, 0.0]), event=1.0)
    stage = stage_of(law)
    sent, leans = SENT, []
    for n in range(12):
        sent = stage.fly(VEHICLE, 0.01, reference(), sent, DT_S).limited.setpoint
        leans.append(pitch_of(sent))
        law.event = 0.0
        law.accel = np.array([0.0, 0.0, float(n)])  # not an event: not worth sending
    wanted = math.atan2(3.0, 9.8)
    np.testing.assert_allclose(leans, [min(0.06 * (n + 1), wanted) for n in range(12)], atol=1e-9)


def test_a_setpoint_is_new_in_the_first_cycle_at_events_and_when_the_heading_has_turned() -> None:
    law = Script()
    stage, said = stage_of(law), []
    for event, yaw_rad in ((0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (0.0, 1.1 * YAW_STEP_RAD), (0.0, 1.1 * YAW_STEP_RAD)):
        law.event = event
        said.append(stage.fly(VEHICLE, 0.01, reference(yaw_rad), SENT, DT_S).is_new)
    assert said == [True, False, True, True, False]


def test_a_heading_that_turns_is_sent_without_an_event() -> None:
    law = Script()
    stage, sent = stage_of(law), SENT
    for _ in range(3):
        sent = stage.fly(VEHICLE, 0.01, reference(), sent, DT_S).limited.setpoint
    little = stage.fly(VEHICLE, 0.01, reference(0.9 * YAW_STEP_RAD), sent, DT_S).limited.setpoint
    assert same_setpoint(little, sent)
    more = stage.fly(VEHICLE, 0.01, reference(1.1 * YAW_STEP_RAD), sent, DT_S).limited.setpoint
    assert 2.0 * math.atan2(float(more.q_w_flu_wxyz[3]), float(more.q_w_flu_wxyz[0])) == pytest.approx(0.022)


def test_the_law_begins_afresh_after_forgetting() -> None:
    law = Script(event=1.0)
    stage = stage_of(law)
    for expected in (0, 1, 2):
        assert stage.fly(VEHICLE, 0.01, reference(), SENT, DT_S).law_output.signals["cycle"] == expected
    stage.forget()
    assert stage.fly(VEHICLE, 0.01, reference(), SENT, DT_S).law_output.signals["cycle"] == 0
    assert law.begun == 2


def test_a_second_half_that_raises_is_not_tried_again() -> None:
    class Halves(Script):
        broken = False

        def decide(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:
            return self.step(memory, now)

        def settle(self, decided: Any) -> tuple[Any, dict[str, Array]]:
            if self.broken:
                raise ZeroDivisionError
            return decided, {}

    stage = stage_of(law := Halves())
    stage.fly(VEHICLE, 0.01, reference(), SENT, DT_S)
    law.broken = True
    with pytest.raises(ZeroDivisionError):
        stage.settle()
    assert stage.settle() == {}
    stage.fly(VEHICLE, 0.01, reference(), SENT, DT_S)
    assert len(law.seen) == 2, "it goes on from what it remembered before"


def test_on_the_ground_the_rotors_may_idle_and_the_vehicle_stays_level() -> None:
    stage, sent = stage_of(Script()), idle_setpoint(0.4)
    limited = stage.on_ground(0.4, 0.02, sent, DT_S)
    assert float(limited.setpoint.thrust) == 0.02, "below the least thrust of flight"
    np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, [math.cos(0.2), 0.0, 0.0, math.sin(0.2)])
    assert float(stage.on_ground(0.4, 0.5, sent, DT_S).setpoint.thrust) == pytest.approx(0.05), "and climbs at its rate"


def test_what_is_not_finite_never_goes_out() -> None:
    law = Script(np.array([math.nan, 0.0, 0.0]), event=1.0)
    stage = stage_of(law)
    limited = stage.fly(VEHICLE, 0.01, reference(), SENT, DT_S).limited
    assert limited.not_finite
    assert same_setpoint(limited.setpoint, SENT)


@pytest.mark.parametrize("name", ["practical", "pid"])
@pytest.mark.parametrize("absurd", [1e30, 1e200, -1e308, math.inf, math.nan])
def test_an_absurd_state_breaks_nothing_and_never_goes_out(name: str, absurd: float) -> None:
    """Python's floats raise where numpy gives an infinity: a law that diverges must still leave it to the gate."""
    still, vector = np.zeros(3), np.array([0.1, absurd, 0.0])
    for vehicle in (VehicleState(0.0, vector, still, LEVEL, still), VehicleState(0.0, still, vector, LEVEL, still)):
        stage = ControlPipeline(load_controller(name, VehicleModel(), DT_S).law, ThrustModel(), LIMITS)
        setpoint = SENT
        with np.errstate(all="ignore"):
            for _ in range(20):
                setpoint = stage.fly(vehicle, 0.01, reference(), setpoint, DT_S).limited.setpoint
                stage.settle()
                assert np.isfinite(setpoint.q_w_flu_wxyz).all()
                assert LIMITS.min_thrust <= float(setpoint.thrust) <= LIMITS.max_thrust


def test_equal_setpoints_are_equal_to_the_last_bit() -> None:
    a = AttitudeThrust(LEVEL, np.array(0.5))
    assert same_setpoint(a, AttitudeThrust(LEVEL.copy(), np.array(0.5)))
    assert not same_setpoint(a, replace(a, thrust=np.array(0.5000000001)))
    assert not same_setpoint(a, replace(a, q_w_flu_wxyz=LEVEL + np.array([0.0, 1e-15, 0.0, 0.0])))
    both = AttitudeThrust(np.array([LEVEL, -LEVEL, LEVEL]), np.array([0.5, 0.5, 0.5000000001]))
    np.testing.assert_array_equal(changed(both, a), [False, True, True])
    assert not same_setpoint(both, a)


@dataclass(frozen=True)
class Cycle:
    """Inputs of the pipeline in one cycle."""

    vehicle: VehicleState
    age_s: Any
    ahead: Reference
    known_accel_w_mps2: Array

    def alone(self, index: tuple[int, ...]) -> "Cycle":
        """The same for one vehicle of the batch."""
        v, r = self.vehicle, self.ahead
        return Cycle(
            VehicleState(
                0.0, v.position_w_m[index], v.velocity_w_mps[index], v.q_w_flu_wxyz[index], v.rate_flu_radps[index]
            ),
            float(self.age_s[index][0]),
            Reference(
                r.position_w_m[index],
                r.velocity_w_mps[index],
                r.acceleration_w_mps2[index],
                float(np.asarray(r.yaw_rad)[index]),
            ),
            self.known_accel_w_mps2[index],
        )

    def flown(self, stage: ControlPipeline, sent: AttitudeThrust) -> tuple[AttitudeThrust, ControlOutput]:
        """One cycle after `sent`."""
        asked = stage.fly(self.vehicle, self.age_s, self.ahead, sent, DT_S, self.known_accel_w_mps2)
        stage.settle()
        return asked.limited.setpoint, asked.law_output


def wandering(lead: tuple[int, ...], cycles: int) -> list[Cycle]:
    """Vehicles that drift about their references, some by millimetres and some by much; their headings turn slowly."""
    rng = np.random.default_rng(5)

    def vectors(size: Array | float) -> Array:
        return np.asarray(size * rng.normal(size=(*lead, 3)))

    spread, turning = 10.0 ** rng.uniform(-4.0, -0.5, (*lead, 1)), rng.uniform(-0.5, 0.5, lead)
    there, error, error_rate = vectors(1.0), vectors(spread), vectors(spread)
    found = []
    for n in range(cycles):
        error, error_rate = error + DT_S * error_rate, error_rate + vectors(0.3 * spread) - DT_S * error
        v, a, q = vectors(0.1 * spread), vectors(spread), quat_from_rotation_vector(vectors(spread))
        vehicle = VehicleState(0.0, there + error, v + error_rate, q, vectors(spread))
        yaw_rad: Any = turning * n * DT_S
        age_s = rng.uniform(0.005, 0.03, (*lead, 1))
        found.append(Cycle(vehicle, age_s, Reference(there, v, a, yaw_rad), vectors(0.1 * spread)))
    return found


@pytest.mark.parametrize("name", ["practical", "pid"])
@pytest.mark.parametrize("lead", [(6,), (2, 2)])
def test_a_batch_is_its_vehicles_each_through_a_stage_of_its_own(name: str, lead: tuple[int, ...]) -> None:
    def stage(shape: tuple[int, ...]) -> ControlPipeline:
        law = load_controller(name, VehicleModel(), DT_S).law
        return ControlPipeline(law, ThrustModel(curve=0.3), LIMITS, shape)

    whole, alone = stage(lead), {index: stage(()) for index in np.ndindex(*lead)}
    setpoint, sent = idle_setpoint(np.zeros(lead)), dict.fromkeys(alone, idle_setpoint(0.0))
    apart = 0
    for cycle in wandering(lead, 100):
        setpoint, output = cycle.flown(whole, setpoint)
        assert setpoint.q_w_flu_wxyz.shape == (*lead, 4)
        assert setpoint.thrust.shape == lead
        apart += bool(output.event.any() and not output.event.all())
        for index, one in alone.items():
            single, its_output = cycle.alone(index).flown(one, sent[index])
            sent[index] = single
            np.testing.assert_array_equal(output.event[index], its_output.event)
            np.testing.assert_allclose(setpoint.q_w_flu_wxyz[index], single.q_w_flu_wxyz, rtol=1e-11, atol=1e-12)
            np.testing.assert_allclose(setpoint.thrust[index], single.thrust, rtol=1e-11)
    assert name == "pid" or apart > 50, "mostly some vehicles have an event and some have none"


def test_in_a_batch_each_vehicle_holds_its_own_setpoint_until_its_event_or_its_heading_turns() -> None:
    class Some(Script):
        def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:  # noqa: ARG002
            return memory, ControlOutput(self.accel, np.array([[1.0], [0.0], [0.0]]), {})

    law, yaw_rad = Some(), np.array([0.0, 0.0, 1.5 * YAW_STEP_RAD])
    stage = ControlPipeline(law, ThrustModel(), LIMITS, (3,))
    sent = idle_setpoint(np.zeros(3), 0.5)
    batch = VehicleState(0.0, np.zeros((3, 3)), np.zeros((3, 3)), np.tile(LEVEL, (3, 1)), np.zeros((3, 3)))
    law.accel = np.zeros((3, 3))
    stage.fly(batch, 0.01, reference(), sent, DT_S)
    law.accel = np.tile([0.0, 0.0, 0.49], (3, 1))  # 5 % of gravity: thrust 0.5 -> 0.525
    turned: Any = yaw_rad
    result = stage.fly(batch, 0.01, reference(turned), sent, DT_S)
    setpoint = result.limited.setpoint
    np.testing.assert_array_equal(result.is_new, [True, False, True])
    np.testing.assert_allclose(setpoint.thrust, [0.525, 0.5, 0.525])
    np.testing.assert_allclose(2.0 * np.arctan2(setpoint.q_w_flu_wxyz[:, 3], setpoint.q_w_flu_wxyz[:, 0]), yaw_rad)


# --- with a guard ---

FENCE = Fence((-4.5, -4.5), (4.5, 4.5, 3.5))
GUARD = Guard(LIMITS, ThrustModel(), FENCE, AgeRange(0.05, 0.10))


def guarded(law: Script) -> ControlPipeline:
    return ControlPipeline(law, ThrustModel(), LIMITS, guard=GUARD)


def test_the_guard_has_the_last_word_on_the_state_and_its_age() -> None:
    law = Script(np.array([3.0, 0.0, 0.0]), event=1.0)
    wall = replace(VEHICLE, position_w_m=np.array([4.6, 0.0, 1.0]))
    assert pitch_of(guarded(law).fly(VEHICLE, 0.01, reference(), SENT, DT_S).limited.setpoint) == pytest.approx(0.06)
    limited = guarded(law).fly(wall, 0.01, reference(), SENT, DT_S).limited
    assert limited.fence_cut
    assert pitch_of(limited.setpoint) == pytest.approx(-0.06)
    limited = guarded(law).fly(VEHICLE, 0.2, reference(), SENT, DT_S).limited
    assert limited.age_cut
    assert float(limited.setpoint.thrust) == pytest.approx(0.485)
    assert pitch_of(stage_of(law).fly(wall, 0.2, reference(), SENT, DT_S).limited.setpoint) == pytest.approx(0.06), (
        "without one"
    )


def test_the_law_is_told_what_the_guard_made_of_it() -> None:
    law = Script(np.array([3.0, 0.0, 0.0]), event=1.0)
    stage, sent = guarded(law), SENT
    law.seen.clear()
    wall = replace(VEHICLE, position_w_m=np.array([4.6, 0.0, 1.0]))
    for _ in range(2):
        sent = stage.fly(wall, 0.01, reference(), sent, DT_S).limited.setpoint
    # leaning back by 0.06 rad after 10 ms, the thrust from 0.5 to 0.55: see above
    assert law.seen[1].sent_accel_w_mps2[0] == pytest.approx(-1.1 * 9.8 * math.sin(0.06))


def test_level_is_level_even_without_a_heading() -> None:
    assert same_setpoint(guarded(Script()).level(0.4, 0.48), stage_of(Script()).level(0.4, 0.48))
    for yaw_rad, thrust in ((math.nan, 0.48), (0.0, math.nan)):
        level = guarded(Script()).level(yaw_rad, thrust)
        np.testing.assert_allclose(level.q_w_flu_wxyz, LEVEL)
        assert float(level.thrust) == pytest.approx(0.485)


LEGAL: list[tuple[str, Trajectory]] = [
    (
        "to both walls of the room at up to 2 m/s",
        Ellipse(np.array([0.0, 0.0, 1.5]), (4.0, 4.0), LapTiming(12.6, 1, 4.0)),
    ),
    (
        "along the fence, 0.3 m from it, at up to 2 m/s",
        MinimumJerk(start_w_m=np.array([4.2, -3.2, 1.5]), end_w_m=np.array([4.2, 3.2, 1.5]), duration_s=6.0),
    ),
    (
        "up to the top of the room",
        MinimumJerk(start_w_m=np.array([4.0, 0.0, 0.5]), end_w_m=np.array([-4.0, 0.0, 3.0]), duration_s=7.6),
    ),
]


@pytest.mark.parametrize("name", ["practical", "pid"])
@pytest.mark.parametrize("trajectory", [t for _, t in LEGAL], ids=[words for words, _ in LEGAL])
def test_a_legal_flight_is_the_same_to_the_last_bit_with_and_without_guard(name: str, trajectory: Trajectory) -> None:
    law = load_controller(name, VehicleModel(), DT_S).law
    stage = ControlPipeline(law, ThrustModel(), LIMITS, guard=GUARD)
    bare = ControlPipeline(load_controller(name, VehicleModel(), DT_S).law, ThrustModel(), LIMITS)
    state = plant.at_rest(flip_yz(trajectory.at(0.0).position_w_m))
    state = replace(state, thrust_n=np.array(PlantParams().mass_kg * 9.8), on_ground=np.array(False))
    sent, nothing, largest_m = [SENT] * 4, plant.no_wrench(), 0.0
    for n in range(round(trajectory.duration_s / DT_S)):
        place, velocity = flip_yz(state.position_ned_m), flip_yz(state.velocity_ned_mps)
        rate, q = flip_yz(state.rate_frd_radps), flip_quat(state.q_ned_frd_wxyz)
        vehicle = VehicleState(0.0, place, velocity, q, rate)
        ahead = trajectory.at(n * DT_S + stage.preview_s)
        setpoints = [one.fly(vehicle, 0.01, ahead, sent[-1], DT_S).limited.setpoint for one in (stage, bare)]
        assert same_setpoint(*setpoints), f"at {n * DT_S:.2f} s"
        sent = [*sent[1:], setpoints[0]]
        asked = Actuation(flip_quat(sent[0].q_w_flu_wxyz), sent[0].thrust)
        for _ in range(2):
            state = plant_one.step(state, asked, nothing, PlantParams(), 0.5 * DT_S)
        largest_m = max(largest_m, float(np.linalg.norm(place - trajectory.at(n * DT_S).position_w_m)))
    assert largest_m < (0.2 if name == "practical" else 1.0), "and it was flown"
