"""Reaction of moving arms on the simulated vehicle, against differences of momentum and a scale's reading."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mock_autopilot.physics import plant
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.arm_bodies import ArmBodies, JointState, Moving, Three, add, arm_motion, gravity_load_nm
from mock_autopilot.physics.arms import JOINT_COUNT, Arms, Assembly, Coupling
from mock_autopilot.physics.plant import GRAVITY_MPS2, PlantState

BODIES = ArmBodies()
MASS_KG = 4.85
STEP_S = 0.002
ANGLES = st.tuples(st.floats(-1.5, 1.5), st.floats(-0.2, 2.6), st.floats(-0.6, 1.2))
RATES = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
ACCELS = st.tuples(*[st.floats(-20.0, 20.0)] * 3)
OUTWARD = st.sampled_from([1.0, -1.0])
STILL: Three = (0.0, 0.0, 0.0)


def later(state: JointState, by_s: float) -> JointState:
    """The joints on a parabola through `state`."""
    angle = [a + r * by_s + 0.5 * c * by_s**2 for a, r, c in zip(state.angle, state.rate, state.accel, strict=True)]
    rate = [r + c * by_s for r, c in zip(state.rate, state.accel, strict=True)]
    return JointState((angle[0], angle[1], angle[2]), (rate[0], rate[1], rate[2]), state.accel)


def difference(before: Three, after: Three, by_s: float) -> np.ndarray:
    return np.asarray((np.array(after) - np.array(before)) / by_s)


@given(ANGLES, RATES, ACCELS, OUTWARD)
def test_momentum_and_force_are_the_derivatives_of_the_moment(a: Three, r: Three, c: Three, outward: float) -> None:
    now, h = JointState(a, r, c), 1e-5
    before, at, after = (arm_motion(BODIES, later(now, by), outward) for by in (-h, 0.0, h))
    assert difference(before.moment, after.moment, 2 * h) == pytest.approx(np.array(at.momentum), abs=1e-7)
    assert difference(before.momentum, after.momentum, 2 * h) == pytest.approx(np.array(at.force), abs=1e-6)


@given(ANGLES, OUTWARD)
def test_the_weight_on_a_joint_is_the_slope_of_the_potential_energy(a: Three, outward: float) -> None:
    def energy_j(angle: Three) -> float:
        return -GRAVITY_MPS2 * arm_motion(BODIES, JointState(angle, STILL, STILL), outward).moment[2]  # z is down

    h = 1e-6
    for joint, load in enumerate(gravity_load_nm(BODIES, a)):
        up, down = (tuple(x + sign * h * (k == joint) for k, x in enumerate(a)) for sign in (1, -1))
        assert load == pytest.approx(-(energy_j(up) - energy_j(down)) / (2 * h), abs=1e-7)  # type: ignore[arg-type]


def test_hanging_arms_are_where_the_drawing_has_them() -> None:
    hanging = arm_motion(BODIES, JointState(STILL, STILL, STILL), 1.0)
    depths = 0.14 * (0.08 + 0.11) + 0.10 * (0.08 + 0.15 + 0.03) + 0.16 * (0.08 + 0.15 + 0.05 + 0.09)
    assert hanging.moment == pytest.approx((0.0, 0.40 * 0.13, depths))


def test_a_raised_pitch_leads_forward_and_a_raised_roll_outward() -> None:
    def moment(angle: Three, outward: float) -> Three:
        return arm_motion(BODIES, JointState(angle, STILL, STILL), outward).moment

    assert moment((0.5, 0.0, 0.0), 1.0)[0] > 0.0
    assert moment((0.0, 0.5, 0.0), -1.0)[0] > 0.0
    assert moment((0.0, 0.0, 0.5), 1.0)[1] > moment(STILL, 1.0)[1]
    assert moment((0.0, 0.0, 0.5), -1.0)[1] < moment(STILL, -1.0)[1]


def both(state: JointState) -> Moving:
    """The two arms moving alike."""
    return add(arm_motion(BODIES, state, 1.0), arm_motion(BODIES, state, -1.0))


def three(values: np.ndarray) -> Three:
    x, y, z = values.tolist()
    return x, y, z


class Scripted:
    """Servos whose angles are a function of time."""

    def __init__(self, motion: JointState) -> None:
        self._start, self._now_s = motion, 0.0
        self.loads: tuple[float, ...] = ()

    def step(self, dt_s: float, load_nm: tuple[float, ...]) -> None:
        self._now_s += dt_s
        self.loads = load_nm

    def motion(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        now = later(self._start, self._now_s)
        angle = (*(math.pi + a for a in now.angle), math.radians(150.0))
        return angle * 2, (*now.rate, 0.0) * 2, (*now.accel, 0.0) * 2


def arms_on(motion: JointState, trim_time_s: float = 0.75) -> Arms:
    return Arms(Assembly(), Scripted(motion), MASS_KG, (trim_time_s,) * 3)


def hovering(yaw_rad: float = 0.0) -> PlantState:
    state = plant.at_rest(np.array([0.0, 0.0, -1.0]), yaw_rad)
    return replace(state, thrust_n=np.asarray(MASS_KG * GRAVITY_MPS2), on_ground=np.zeros((), dtype=bool))


def test_both_arms_together_push_straight_back_and_down() -> None:
    wrench = arms_on(JointState((0.0, 0.3, 0.0), STILL, (10.0, 0.0, 0.0))).step(hovering(), STEP_S)
    assert wrench.force_ned_n[0] < -0.1, "arms thrown forward throw the vehicle back"
    assert wrench.force_ned_n[1] == pytest.approx(0.0, abs=1e-12), "the two arms are mirror images"
    turned = arms_on(JointState((0.0, 0.3, 0.0), STILL, (10.0, 0.0, 0.0))).step(hovering(math.pi / 2), STEP_S)
    assert turned.force_ned_n[1] == pytest.approx(wrench.force_ned_n[0]), "the force turns with the vehicle"


def test_what_arms_give_the_vehicle_over_a_whole_swing_is_nothing() -> None:
    """Momentum out and back: the impulses of a motion from rest to rest add up to zero."""
    forth, back = JointState((0.0, 0.3, 0.1), STILL, (8.0, -5.0, 3.0)), 0.1
    arms = arms_on(forth)
    impulse = sum(arms.step(hovering(), STEP_S).force_ned_n[0] * STEP_S for _ in range(round(back / STEP_S)))
    end = later(forth, back)
    stopping = arms_on(end._replace(accel=(-8.0, 5.0, -3.0)))
    impulse += sum(stopping.step(hovering(), STEP_S).force_ned_n[0] * STEP_S for _ in range(round(back / STEP_S)))
    assert impulse == pytest.approx(0.0, abs=2e-3)


def test_arms_held_forward_tip_the_nose_down_until_the_autopilot_has_trimmed_it() -> None:
    arms = arms_on(JointState((0.6, 0.8, 0.0), STILL, STILL), trim_time_s=0.5)
    pushes = [arms.step(hovering(), STEP_S).angular_frd_radps2 for _ in range(1500)]
    moment: Moving = arm_motion(BODIES, JointState((0.6, 0.8, 0.0), STILL, STILL), 1.0)
    expected = -2.0 * moment.moment[0] * GRAVITY_MPS2 / 0.10
    assert pushes[0] == pytest.approx(np.array([0.0, expected, 0.0])), "nose down: negative about FRD y"
    assert pushes[249][1] == pytest.approx(expected * math.exp(-1.0), rel=0.01)
    assert abs(pushes[-1][1]) < 0.01 * abs(expected)


def test_on_the_ground_the_floor_takes_every_torque() -> None:
    standing = plant.at_rest(np.zeros(3))
    wrench = arms_on(JointState((0.6, 0.8, 0.0), STILL, STILL)).step(standing, STEP_S)
    assert not wrench.angular_frd_radps2.any()


def test_a_turning_vehicle_feels_the_arms_it_swings_round() -> None:
    """Still arms on a vehicle that turns steadily: the force that keeps their centre of mass on its circle."""
    arms = arms_on(JointState((0.6, 0.8, 0.0), STILL, STILL))
    spinning = replace(hovering(), rate_frd_radps=np.array([0.0, 0.0, 2.0]))
    arms.step(spinning, STEP_S)
    force = arms.step(spinning, STEP_S).force_ned_n
    offset = 2.0 * arm_motion(BODIES, JointState((0.6, 0.8, 0.0), STILL, STILL), 1.0).moment[0]
    assert force == pytest.approx(np.array([4.0 * offset, 0.0, 0.0])), "outward, towards the arms"


def test_a_trimmed_pose_does_not_turn_a_hovering_vehicle() -> None:
    """Until the arms move away from it: then as much as they would have turned it otherwise, less the trim."""
    held, raised = (both(JointState(angle, STILL, STILL)) for angle in ((0.6, 0.8, 0.0), (0.9, 0.8, 0.0)))
    coupling = Coupling(held, MASS_KG, Assembly().inertia_kgm2, (0.75,) * 3)
    assert coupling.step(hovering(), held, STEP_S).angular_frd_radps2 == pytest.approx(np.zeros(3), abs=1e-12)
    more = -(raised.moment[0] - held.moment[0]) * GRAVITY_MPS2 / 0.10
    assert coupling.step(hovering(), raised, STEP_S).angular_frd_radps2 == pytest.approx(np.array([0.0, more, 0.0]))


@settings(max_examples=25)
@given(ANGLES, RATES, ACCELS, st.integers(0, 2**32 - 1))
def test_a_batch_of_vehicles_is_pushed_as_each_would_be_alone(a: Three, r: Three, c: Three, seed: int) -> None:
    """One motion of the arms under vehicles of different mass and inertia, each with attitudes and rates of its own."""
    rng, motion, lead = np.random.default_rng(seed), JointState(a, r, c), (2, 2)
    mass_kg, inertia_kgm2 = rng.uniform(3.0, 6.0, lead), rng.uniform(0.05, 0.2, (*lead, 3))
    trim_s = (0.3, 0.75, math.inf)
    alone = {
        i: Arms(Assembly(inertia_kgm2=three(inertia_kgm2[i])), Scripted(motion), mass_kg[i], trim_s)
        for i in np.ndindex(lead)
    }
    coupling = Coupling(None, mass_kg, inertia_kgm2, trim_s)
    for step in range(1, 5):
        vehicles = replace(
            plant.at_rest(rng.normal(size=(*lead, 3))),
            q_ned_frd_wxyz=quat.unit(rng.normal(size=(*lead, 4))),
            rate_frd_radps=rng.normal(size=(*lead, 3)),
            thrust_n=rng.uniform(30.0, 60.0, lead),
            on_ground=rng.random(lead) < 0.3,
        )
        wrench = coupling.step(vehicles, both(later(motion, step * STEP_S)), STEP_S)
        for i, arms in alone.items():
            one = PlantState(**{item.name: np.asarray(getattr(vehicles, item.name)[i]) for item in fields(PlantState)})
            expected = arms.step(one, STEP_S)
            assert wrench.force_ned_n[i] == pytest.approx(expected.force_ned_n, abs=1e-9)
            assert wrench.angular_frd_radps2[i] == pytest.approx(expected.angular_frd_radps2, abs=1e-9)


def test_servos_feel_the_weight_in_their_own_sense() -> None:
    servos = Scripted(JointState((0.6, 0.8, 0.2), STILL, STILL))
    flipped = Assembly(direction=(1, -1, 1, 1, 1, 1, 1, 1), zero_rad=((math.pi,) * 3 + (math.radians(150.0),)) * 2)
    Arms(flipped, servos, MASS_KG, (0.75,) * 3).step(hovering(), STEP_S)
    assert len(servos.loads) == JOINT_COUNT
    assert servos.loads[0] < 0.0, "lifted arms want down again"
    assert servos.loads[3] == servos.loads[7] == 0.0
    angle = servos.motion()[0]
    bent = gravity_load_nm(BODIES, (angle[0] - math.pi, math.pi - angle[1], angle[2] - math.pi))
    assert servos.loads[1] == pytest.approx(-bent[1], rel=1e-3)
