"""The estimator of a flight is the Python one, number by number, whatever its frames are."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.compiled.leaves import leaves
from companion.compiled.library import library
from companion.core.types import MocapFrame, OtherBody
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorState, Verdict
from companion.estimation.frame_estimator import FrameEstimator
from tests.estimation.flights import PARAMS, Sway, frame, lost, noisy

compiled = pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")
NOISY = noisy(Sway(4.0), 120)


def troubled(kind: str, one: MocapFrame, index: int) -> MocapFrame:
    """One frame with something that a flight's frames may have."""
    if kind == "lost":
        return replace(lost(index), received_s=one.received_s)
    if kind == "others":
        return replace(one, others=(OtherBody("dauam-2", (1.0, 2.0, 0.5)),))
    changes: dict[str, dict[str, Any]] = {
        "away": {"position_w_m": one.position_w_m + 2.0},
        "at the gate": {"position_w_m": one.position_w_m + np.array((0.03, 0.002, 0.0))},
        "outside": {"position_w_m": one.position_w_m + 300.0},
        "no rotation": {"rotation_w_b": 1.1 * one.rotation_w_b},
        "repeated": {name: getattr(NOISY[index - 1], name) for name in ("position_w_m", "rotation_w_b")},
        "stale": {"stamp_s": one.stamp_s - 0.03},
        "ahead": {"stamp_s": one.stamp_s + 1.0},
        "held up": {"received_s": one.received_s + 0.2},
        "early": {"received_s": one.received_s - 0.004},
        "another clock": {"stamp_s": one.stamp_s - 100.0},
    }
    return replace(one, **changes[kind])


KINDS = ("lost", "away", "at the gate", "outside", "no rotation", "repeated", "stale", "ahead", "held up", "early")
troubles = st.lists(
    st.tuples(st.sampled_from((*KINDS, "others", "another clock")), st.integers(1, 118), st.integers(1, 14)), max_size=5
)


def same(one: EstimatorState, other: EstimatorState) -> None:
    assert (one.verdict, one.run, one.counts, one.agreeing) == (other.verdict, other.run, other.counts, other.agreeing)
    pairs = list(zip(leaves(one), leaves(other), strict=True))
    assert [path for (path, _), _ in pairs] == [path for _, (path, _) in pairs]
    for (path, value), (_, wanted) in pairs:
        np.testing.assert_array_equal(value, wanted, err_msg=path)


@given(found=troubles, looks=st.sets(st.integers(0, 119), max_size=20))
@settings(max_examples=20, deadline=None)
def test_every_number_is_the_same_whatever_the_frames(found: list[tuple[str, int, int]], looks: set[int]) -> None:
    """`looks` are the frames after which the whole state is asked for."""
    kinds = {index: kind for kind, first, count in found for index in range(first, min(first + count, 119))}
    fast, state = FrameEstimator(PARAMS), EstimatorState()
    for index, one in enumerate(NOISY):
        seen = troubled(kinds[index], one, index) if index in kinds else one
        state = estimator.step(state, seen, PARAMS)
        fast.step(seen)
        assert fast.verdict is state.verdict
        assert (fast.vehicle is None) == (state.vehicle is None)
        if fast.vehicle is not None and state.vehicle is not None:
            for name, value in vars(state.vehicle).items():
                np.testing.assert_array_equal(getattr(fast.vehicle, name), value, err_msg=name)
        if index in looks:
            same(fast.state, state)
    same(fast.state, state)


@compiled
def test_usual_frames_are_taken_by_the_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    fast, seen = FrameEstimator(PARAMS), list[int]()
    real = estimator.step

    def step(*args: Any) -> EstimatorState:
        seen.append(args[1].frame)
        return real(*args)

    monkeypatch.setattr(estimator, "step", step)
    for one in [*NOISY[:50], lost(50), *NOISY[51:]]:
        fast.step(one)
    assert seen == [0, 50]


@pytest.mark.parametrize("at", [0.0, 4.999, 5.0, 5.001, 9.99])
def test_the_clock_is_followed_over_its_windows(at: float) -> None:
    fast, state = FrameEstimator(PARAMS), EstimatorState()
    rng = np.random.default_rng(3)
    for number in range(0, 1200, 4):  # 25 Hz
        one = frame(number, (0.001 * rng.normal(), 0.0, 1.0), stamp_s=at + 0.01 * number)
        one = replace(one, received_s=one.received_s + 0.01 * rng.random())
        state = estimator.step(state, one, PARAMS)
        fast.step(one)
    assert state.counts.accepted > 290
    same(fast.state, state)


def test_a_vehicle_state_that_was_given_stays_as_it_was() -> None:
    fast = FrameEstimator(PARAMS)
    kept = []
    for one in NOISY[:20]:
        fast.step(one)
        assert fast.vehicle is not None
        kept.append((fast.vehicle, fast.vehicle.position_w_m.copy()))
    assert fast.verdict is Verdict.ACCEPTED
    assert all(np.array_equal(vehicle.position_w_m, position) for vehicle, position in kept)
