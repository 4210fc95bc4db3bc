"""Two derivations of the same arms, in two frames, sharing no code: a sign error in one shows against the other."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.arms.dynamics import com_shift_flu_m, reaction_force_b_n, reaction_torque_b_nm
from companion.arms.feedforward import Airframe, turning_b_radps2
from companion.arms.model import ArmModel
from companion.core.types import Array, JointMotion
from mock_autopilot.physics import plant
from mock_autopilot.physics.arm_bodies import ArmBodies, JointState, Moving, add, arm_motion
from mock_autopilot.physics.arms import Arms, Assembly

MODEL, BODIES = ArmModel(), ArmBodies()
MASS_KG = 4.85
FLU_OF_FRD = np.array([1.0, -1.0, -1.0])
ANGLE = st.floats(-1.5, 1.5)
RATE = st.floats(-3.0, 3.0)
ACCEL = st.floats(-20.0, 20.0)


def eight(each: st.SearchStrategy[float]) -> st.SearchStrategy[Array]:
    return st.lists(each, min_size=8, max_size=8).map(np.array)


MOTIONS = st.builds(JointMotion, eight(ANGLE), eight(RATE), eight(ACCEL))


def in_the_mock(motion: JointMotion) -> Moving:
    def arm(first: int, outward: float) -> Moving:
        a, r, c = (
            tuple(values[first : first + 3].tolist())
            for values in (motion.position_rad, motion.velocity_radps, motion.acceleration_radps2)
        )
        return arm_motion(BODIES, JointState(a, r, c), outward)

    return add(arm(0, 1.0), arm(4, -1.0))


def test_both_start_from_the_same_arms() -> None:
    assert [link.length_m for link in MODEL.links] == list(BODIES.link_length_m)
    assert [link.mass_kg for link in MODEL.links] == list(BODIES.link_mass_kg)
    assert [link.com_m for link in MODEL.links] == list(BODIES.link_com_m)
    x, y, z = BODIES.shoulder_frd_m
    assert MODEL.shoulder_flu_m == (x, y, -z)


@given(MOTIONS)
def test_centre_of_mass_force_and_torque_agree(motion: JointMotion) -> None:
    mock = in_the_mock(motion)
    ours = com_shift_flu_m(MODEL, motion.position_rad, MASS_KG) * MASS_KG
    assert ours == pytest.approx(FLU_OF_FRD * np.array(mock.moment), abs=1e-12)
    assert reaction_force_b_n(MODEL, motion) == pytest.approx(-FLU_OF_FRD * np.array(mock.force), abs=1e-10)
    assert reaction_torque_b_nm(MODEL, motion) == pytest.approx(-FLU_OF_FRD * np.array(mock.torque), abs=1e-10)


class Posed:
    """Servos at a motion, for one instant."""

    def __init__(self, motion: JointMotion) -> None:
        centre = np.array(((math.pi,) * 3 + (math.radians(150.0),)) * 2)
        self._motion = (
            tuple((centre + motion.position_rad).tolist()),
            tuple(motion.velocity_radps.tolist()),
            tuple(motion.acceleration_radps2.tolist()),
        )

    def step(self, dt_s: float, load_nm: tuple[float, ...]) -> None:
        """Nothing moves."""

    def motion(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        return self._motion


@given(MOTIONS)
def test_a_hovering_vehicle_is_turned_as_the_feed_forward_expects(motion: JointMotion) -> None:
    hovering = plant.PlantState(
        position_ned_m=np.array([0.0, 0.0, -1.0]),
        velocity_ned_mps=np.zeros(3),
        q_ned_frd_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        rate_frd_radps=np.zeros(3),
        thrust_n=np.asarray(MASS_KG * 9.8),
        acceleration_ned_mps2=np.zeros(3),
        on_ground=np.zeros((), dtype=bool),
        turn_frd_radps2=np.zeros(3),
    )
    assembly = Assembly()
    push = Arms(assembly, Posed(motion), MASS_KG, (0.75,) * 3).step(hovering, 0.002).angular_frd_radps2
    airframe = Airframe(MASS_KG, 9.8, assembly.inertia_kgm2, 7.7, 0.75)
    assert turning_b_radps2(MODEL, airframe, motion) == pytest.approx(FLU_OF_FRD * push, abs=1e-9)
