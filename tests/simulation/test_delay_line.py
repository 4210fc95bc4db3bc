"""Delay lines against a plain list of all that was ever put in."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.simulation.virtual_body import DelayLine, EachDelayLine


def brute_force(delay: int, first: float, values: list[float]) -> list[float]:
    """Return the output after each value: the one `delay` before it, at the beginning the first."""
    return [([first] * delay + values)[place] for place in range(len(values))]


NUMBERS = st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40)


@given(st.integers(0, 9), NUMBERS)
def test_what_comes_out_is_what_went_in_so_many_steps_ago(delay: int, values: list[float]) -> None:
    line = DelayLine(delay, np.array([7.0, -7.0]))
    out = [line.put(np.array([value, -value])) for value in values]
    expected = brute_force(delay, 7.0, values)
    assert [tuple(row) for row in out] == [(value, -value) for value in expected]


@given(st.lists(st.integers(0, 9), min_size=1, max_size=5), NUMBERS)
def test_every_vehicle_of_a_batch_has_its_own_delay(delays: list[int], values: list[float]) -> None:
    who = np.arange(len(delays))[:, None]

    def of_all(value: float) -> Array:
        return np.asarray(100.0 * who + np.array([value, -value]))

    line = EachDelayLine(np.array(delays), of_all(7.0))
    out = [line.put(of_all(value)) for value in values]
    for place, delay in enumerate(delays):
        mine = [tuple(row[place]) for row in out]
        assert mine == [(100.0 * place + v, 100.0 * place - v) for v in brute_force(delay, 7.0, values)]


def test_what_came_out_does_not_change_when_more_goes_in() -> None:
    line = EachDelayLine(np.array([1, 2]), np.zeros((2, 1)))
    out = [line.put(np.full((2, 1), float(k))) for k in range(1, 6)]
    assert [row.ravel().tolist() for row in out] == [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [3.0, 2.0], [4.0, 3.0]]
