"""Distances by hand and against dense sampling; the default poses; who is named as too near."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.arms.collision import clearance, distances
from companion.arms.kinematics import points_flu_m
from companion.arms.model import ArmModel, Propellers
from companion.arms.shapes import HALVINGS, between_segments_m, to_box_m, to_discs_m
from companion.config.arms_config import PosesConfig
from companion.core.types import Array
from tests.arms.poses import joints, vectors

MODEL = ArmModel()
POINT = st.tuples(*(st.floats(-0.5, 0.5),) * 3).map(np.array)
SHARES = np.linspace(0.0, 1.0, 201)[:, None]
STEP = math.sqrt(3.0) / 200.0
"""Largest gap between samples of a segment within a cube of 1 m."""

SHORT_M = 1e-7
"""Segments shorter than this may be taken for points."""


def both(chain: tuple[float, float, float]) -> Array:
    return np.array([*chain, 0.0, *chain, 0.0])


def _samples(start: Array, end: Array) -> Array:
    return np.asarray(start + SHARES * (end - start))


def _agrees(found: float, sampled: float, known_to_m: float = SHORT_M) -> None:
    assert found <= sampled + known_to_m
    assert found >= sampled - STEP


def _halved_m(start: Array, end: Array) -> float:
    """Return the error allowed of a distance that is found by halving this segment, m."""
    return float(np.linalg.norm(end - start)) * 0.5**HALVINGS + SHORT_M


@settings(max_examples=60)
@given(a=POINT, b=POINT, c=POINT, d=POINT)
def test_distance_of_segments_is_the_least_between_their_points(a: Array, b: Array, c: Array, d: Array) -> None:
    apart = np.linalg.norm(_samples(a, b)[:, None] - _samples(c, d)[None], axis=-1).min()
    _agrees(float(between_segments_m(a, b, c, d)), float(apart))


@given(a=POINT, b=POINT)
def test_distance_to_the_box_is_the_least_of_the_segments_points(a: Array, b: Array) -> None:
    half = np.array([0.14, 0.09, 0.06])
    beyond = np.maximum(np.abs(_samples(a, b)) - half, 0.0)
    _agrees(float(to_box_m(a, b, half)), float(np.linalg.norm(beyond, axis=1).min()), _halved_m(a, b))


@given(a=POINT, b=POINT)
def test_distance_to_a_disc_is_the_least_of_the_segments_points(a: Array, b: Array) -> None:
    centre = np.array([0.1, -0.1, 0.05])
    points = _samples(a, b) - centre
    outside = np.maximum(np.hypot(points[:, 0], points[:, 1]) - 0.17, 0.0)
    sampled = float(np.hypot(outside, points[:, 2]).min())
    _agrees(float(to_discs_m(a, b, centre[None], 0.17)[0]), sampled, _halved_m(a, b))


def test_crossing_parallel_and_pointlike_segments_by_hand() -> None:
    x, y, up = np.eye(3)
    assert between_segments_m(-x, x, up - y, up + y) == pytest.approx(1.0)
    assert between_segments_m(0.0 * x, x, up + 0.5 * x, up + 2.0 * x) == pytest.approx(1.0)
    assert between_segments_m(0.0 * x, x, 3.0 * x, 5.0 * x) == pytest.approx(2.0)
    assert between_segments_m(x, x, -y, -y) == pytest.approx(math.sqrt(2.0))


def test_hanging_arms_are_as_far_apart_as_their_shoulders_less_their_thickness() -> None:
    found = distances(MODEL, np.zeros(8))
    by_name = dict(zip(found.what, found.distance_m, strict=True))
    assert by_name["right forearm and left forearm"] == pytest.approx(0.26 - 0.05)
    # the elbow link begins 0.17 m below and 0.04 m beside the box
    assert by_name["left elbow and the body"] == pytest.approx(math.hypot(0.17, 0.04) - 0.025, abs=1e-6)


def test_a_forearm_under_a_propeller_is_as_far_as_the_height_between() -> None:
    # straight forward: the forearm lies below the front disc, 0.14 m under its height
    found = distances(MODEL, both((math.pi / 2, 0.0, 0.0)))
    by_name = dict(zip(found.what, found.distance_m, strict=True))
    assert by_name["right forearm and a propeller"] == pytest.approx(0.14 - 0.025, abs=1e-6)


def test_forearms_rolled_inward_meet_each_other() -> None:
    near = clearance(MODEL, both((0.0, 0.0, -0.7)))
    assert near.what == "right forearm and left forearm"
    assert near.distance_m == pytest.approx(2.0 * (0.13 - 0.17 * math.sin(0.7)) - 0.05, abs=1e-9)


def test_a_forearm_lifted_into_a_propeller_is_named() -> None:
    near = clearance(MODEL, joints(left_shoulder_pitch=1.4, left_elbow_pitch=1.2))
    assert near.what == "left forearm and a propeller"
    assert near.distance_m < MODEL.margin_m


def test_a_forearm_folded_inward_under_the_body_is_named() -> None:
    wide = replace(MODEL, body_half_flu_m=(0.3, 0.12, 0.06))
    near = clearance(wide, joints(right_shoulder_pitch=1.2, right_elbow_pitch=1.2, right_elbow_roll=-0.6))
    assert near.what == "right forearm and the body"


def test_the_floor_is_asked_only_where_it_is_known() -> None:
    hanging = np.zeros(8)
    assert clearance(MODEL, hanging).distance_m > 0.1
    near = clearance(MODEL, hanging, floor_z_m=-0.5)
    assert near.what == "right forearm and the floor"
    assert near.distance_m == pytest.approx(0.5 - 0.45 - 0.025)


def test_propellers_are_where_the_model_has_them() -> None:
    # two discs left and right: the one at +y is straight above the left arm's reach to the side
    sideways = replace(MODEL, propellers=Propellers(2, 0.1, 0.3, math.pi / 2, 0.0))
    found = distances(sideways, np.zeros(8))
    by_name = dict(zip(found.what, found.distance_m, strict=True))
    # the shoulder is 0.07 m inward of the disc's edge and 0.08 m below it
    assert by_name["left upper arm and a propeller"] == pytest.approx(math.hypot(0.07, 0.08) - 0.025, abs=1e-6)


@given(q=vectors(2.0))
def test_mirrored_arms_have_mirrored_distances(q: Array) -> None:
    mirrored = np.concatenate((q[4:], q[:4]))
    mirrored_m = float(distances(MODEL, mirrored).distance_m.min())
    assert distances(MODEL, q).distance_m.min() == pytest.approx(mirrored_m, abs=1e-6)


@given(q=vectors(2.0), step=vectors(0.05))
def test_no_distance_changes_by_more_than_the_links_travel(q: Array, step: Array) -> None:
    before, after = (distances(MODEL, pose, -0.5).distance_m for pose in (q, q + step))
    travel = np.linalg.norm(points_flu_m(MODEL, q + step) - points_flu_m(MODEL, q), axis=-1).max(-1).sum()
    assert np.abs(after - before).max() <= travel + 1e-6


def test_many_poses_at_once_are_each_as_alone() -> None:
    many = np.random.default_rng(1).uniform(-1.5, 1.5, (4, 3, 8))
    together = distances(MODEL, many, -0.6)
    assert together.distance_m.shape == (4, 3, len(together.what))
    alone = clearance(MODEL, many[2, 1], -0.6)
    assert together.distance_m.min(-1)[2, 1] == pytest.approx(alone.distance_m)


@pytest.mark.parametrize("pose", [PosesConfig().home_rad, PosesConfig().stow_rad, (0.0, 0.0, 0.0)])
def test_the_default_poses_are_well_clear_of_everything(pose: tuple[float, float, float]) -> None:
    assert clearance(MODEL, both(pose)).distance_m > 4.0 * MODEL.margin_m


def test_stowed_arms_are_tucked_up_for_the_landing() -> None:
    lowest = points_flu_m(MODEL, both(PosesConfig().stow_rad))[..., 2].min() - MODEL.link_radius_m
    assert lowest > -0.25
    assert lowest > points_flu_m(MODEL, both(PosesConfig().home_rad))[..., 2].min() + 0.05
