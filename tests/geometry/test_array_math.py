"""One formula for one vehicle and for many: what the small functions give in both cases, and their ways with NaN."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from companion.core.types import Array, Scalar
from companion.geometry.array_math import (
    all_by_axis,
    along_axes,
    any_true,
    by_axis,
    column,
    dot,
    item,
    maximum,
    minimum,
    stack,
    unstack,
    where,
    where_each,
)

ONE = np.array([1.0, -2.0, 3.0])
MANY = np.array([[1.0, -2.0, 3.0], [4.0, 0.5, -6.0]])


def test_what_is_taken_apart_is_put_together_again() -> None:
    assert unstack(ONE) == [1.0, -2.0, 3.0]
    for vector in (ONE, MANY, MANY[None], MANY[:, :1], ONE[:1]):
        np.testing.assert_array_equal(stack(*unstack(vector)), vector)
    np.testing.assert_array_equal(stack(MANY[:, 0], 7.0), [[1.0, 7.0], [4.0, 7.0]])


def test_a_formula_of_one_axis_goes_through_all_axes_of_all_vehicles() -> None:
    gain, offset = np.array([2.0, 3.0, 4.0]), 10.0
    np.testing.assert_array_equal(by_axis(lambda v, g: g * v + offset, ONE, gain), [12.0, 4.0, 22.0])
    np.testing.assert_array_equal(
        by_axis(lambda v, g: g * v + offset, MANY, gain), [[12.0, 4.0, 22.0], [18.0, 11.5, -14.0]]
    )


@pytest.mark.parametrize("vector", [ONE, MANY])
def test_a_formula_may_give_several_vectors(vector: Array) -> None:
    twice, less = all_by_axis(lambda v, g: (2.0 * v, v - g), vector, np.array([1.0, 0.0, -1.0]))
    np.testing.assert_array_equal(twice, 2.0 * vector)
    np.testing.assert_array_equal(less, vector + np.array([-1.0, 0.0, 1.0]))
    first, second = along_axes(lambda v: (2.0 * v, v - 1.0), vector)
    np.testing.assert_array_equal(first, 2.0 * vector)
    np.testing.assert_array_equal(second, vector - 1.0)


def test_vectors_kept_as_floats_stay_floats() -> None:
    assert list(along_axes(lambda v, g: (2.0 * v, v - g), (1.0, -2.0), (0.5, 3.0))) == [(2.0, -4.0), (0.5, -5.0)]


def test_scalars_of_one_vehicle_are_floats_and_scale_vectors_in_both_cases() -> None:
    assert dot(ONE, ONE) == 14.0
    np.testing.assert_array_equal(dot(MANY, ONE), [14.0, -15.0])
    np.testing.assert_array_equal(ONE * column(dot(ONE, ONE)), [14.0, -28.0, 42.0])
    np.testing.assert_array_equal(MANY * column(dot(MANY, ONE)), [[14.0, -28.0, 42.0], [-60.0, -7.5, 90.0]])
    assert item(np.array(0.5)) == 0.5
    np.testing.assert_array_equal(item(np.array([0.5, 0.6])), [0.5, 0.6])


def test_conditions() -> None:
    assert where(True, 1.0, 2.0) == 1.0
    np.testing.assert_array_equal(where(np.array([True, False]), 1.0, 2.0), [1.0, 2.0])
    assert any_true(True)
    assert not any_true(False)
    assert any_true(np.array([False, True]))
    assert not any_true(np.array([False, False]))


@pytest.mark.parametrize(("a", "b"), list(product([-1.0, 0.0, 2.0, math.inf, -math.inf, math.nan], repeat=2)))
def test_bounds_are_numpys_also_for_floats(a: float, b: float) -> None:
    for bound, numpys in ((maximum, np.maximum), (minimum, np.minimum)):
        np.testing.assert_array_equal(bound(a, b), numpys(a, b))
        np.testing.assert_array_equal(bound(np.array([a]), b), [numpys(a, b)])
        np.testing.assert_array_equal(bound(a, np.array([b])), [numpys(a, b)])


def test_values_are_chosen_number_by_number() -> None:
    @dataclass(frozen=True)
    class Filter:
        state: tuple[Scalar, Scalar]
        gain: Scalar

    assert where_each(False, Filter((1.0, 2.0), 3.0), Filter((4.0, 5.0), 6.0)) == Filter((4.0, 5.0), 6.0)
    new, old = Filter((1.0, MANY[0, :2]), 3.0), Filter((4.0, MANY[1, :2]), 6.0)
    chosen = where_each(np.array([True, False]), new, old)
    for part, expected in zip((*chosen.state, chosen.gain), ([1.0, 4.0], [1.0, 0.5], [3.0, 6.0]), strict=True):
        np.testing.assert_array_equal(part, expected)
