"""Their stamps on our clock, whatever the network does to the frames on the way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation.clock_sync import ClockSync, observe, to_local_s

DELAY_S = 0.010
OFFSET_S = 5000.0
"""Our clock minus theirs."""


def watched(
    jitters_s: list[float], drift: float = 0.0, sync: ClockSync | None = None, from_s: float = 0.0
) -> ClockSync:
    """A frame every 10 ms with these waits on top of the fixed delay; our clock runs (1 + drift) times theirs."""
    sync = sync or ClockSync()
    for k, jitter_s in enumerate(jitters_s):
        stamp_s = from_s + 0.01 * k
        sync = observe(sync, stamp_s, OFFSET_S + stamp_s * (1 + drift) + DELAY_S + jitter_s)
    return sync


def test_without_waiting_the_capture_time_is_exact() -> None:
    assert to_local_s(watched([0.0]), 1.0, DELAY_S) == pytest.approx(OFFSET_S + 1.0)


@given(st.lists(st.floats(0.0, 0.2), min_size=1, max_size=300))
def test_no_frame_is_dated_before_its_capture_or_later_than_the_least_wait(jitters_s: list[float]) -> None:
    error_s = to_local_s(watched(jitters_s), 7.0, DELAY_S) - (OFFSET_S + 7.0)
    assert -1e-9 <= error_s <= max(jitters_s) + 1e-9
    assert error_s == pytest.approx(min(jitters_s), abs=1e-9)


def test_jitter_hardly_matters_after_a_second() -> None:
    jitters_s = np.random.default_rng(1).exponential(0.003, size=100).tolist()
    assert to_local_s(watched(jitters_s), 1.0, DELAY_S) == pytest.approx(OFFSET_S + 1.0, abs=0.0005)


@pytest.mark.parametrize("drift", [-50e-6, 50e-6])
def test_a_drifting_clock_is_followed(drift: float) -> None:
    for_s = 600.0
    sync = watched([0.0] * round(for_s / 0.01), drift)
    error_s = to_local_s(sync, for_s, DELAY_S) - (OFFSET_S + for_s * (1 + drift))
    assert abs(error_s) <= 10.0 * abs(drift) + 1e-6, "at most what the clocks part within the window"


def test_a_new_measurement_counts_at_once() -> None:
    sync = watched([0.0] * 100, from_s=1000.0)
    sync = observe(sync, 0.0, OFFSET_S + 2000.0 + DELAY_S)
    assert to_local_s(sync, 0.0, DELAY_S) == pytest.approx(OFFSET_S + 2000.0)


def test_their_clock_jumping_ahead_counts_at_once() -> None:
    sync = observe(watched([0.0] * 100), 31.0, OFFSET_S + 1.0 + DELAY_S)
    assert to_local_s(sync, 31.0, DELAY_S) == pytest.approx(OFFSET_S + 1.0)


def test_a_growing_delay_is_seen_as_age_and_not_as_another_clock() -> None:
    sync = watched([0.3] * 200, sync=watched([0.0] * 300), from_s=3.0)
    assert to_local_s(sync, 5.0, DELAY_S) == pytest.approx(OFFSET_S + 5.0)


def test_what_lies_behind_the_window_is_forgotten() -> None:
    sync = watched([0.3] * 1100, sync=watched([0.0] * 300), from_s=3.0)
    assert to_local_s(sync, 14.0, DELAY_S) == pytest.approx(OFFSET_S + 14.0 + 0.3)
