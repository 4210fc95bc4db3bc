"""Height of the reference while the guard pushes the vehicle away from another one: it is never a reason to climb."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.supervisor.flight_state import FlightState, LandRequest
from companion.supervisor.state_machine import advance, reference_at
from tests.supervisor.flown import DT_S, RULES, apply_request, facts, hovering

HOVER = hovering()
_OFF = st.floats(-0.8, 0.8)
_MOVES = st.floats(-1.5, 1.5)
_TICK = st.tuples(st.tuples(_OFF, _OFF, _OFF), st.tuples(_MOVES, _MOVES, _MOVES), st.booleans())
"""Offset from the reference (m), velocity (m/s), and whether the guard pushes with the last setpoint."""
_HEIGHT_M, _ROUNDING_M = 0.2, 1e-9

Ticks = list[tuple[tuple[float, float, float], tuple[float, float, float], bool]]


def _heights(flight: FlightState, time_s: float, ticks: Ticks) -> list[tuple[float, float, float, bool]]:
    """Return the heights of the reference before and after each tick, of the vehicle, and whether it was pushed."""
    heights = []
    for number, (off, velocity, pushed_now) in enumerate(ticks, 1):
        now_s = time_s + 0.3 * number
        before = reference_at(flight, now_s).position_w_m
        inputs = replace(
            facts(now_s, 1.0),
            position_w_m=before + np.array(off),
            velocity_w_mps=np.array(velocity),
            pushed=True,
            pushed_now=pushed_now,
        )
        flight = advance(flight, inputs, RULES)
        after_m = float(reference_at(flight, now_s).position_w_m[2])
        heights.append((float(before[2]), after_m, float(inputs.position_w_m[2]), pushed_now))
        later_m = float(reference_at(flight, now_s + DT_S).position_w_m[2])
        assert later_m <= after_m + _ROUNDING_M, "nor does it climb afterwards"
    return heights


@given(st.lists(_TICK, min_size=1, max_size=12))
def test_a_landing_that_is_pushed_never_climbs_towards_its_reference(ticks: Ticks) -> None:
    flight, time_s = HOVER
    landing = apply_request(flight, LandRequest(), facts(time_s, 1.0), RULES)
    for before_m, after_m, own_m, pushed_now in _heights(landing, time_s, ticks):
        if after_m > before_m + _ROUNDING_M:
            assert pushed_now
            assert after_m <= own_m - _HEIGHT_M + _ROUNDING_M
        assert after_m <= max(before_m, own_m) + _ROUNDING_M


@given(st.lists(_TICK, min_size=1, max_size=12))
def test_a_hold_that_is_pushed_keeps_its_height_or_follows_behind(ticks: Ticks) -> None:
    flight, time_s = HOVER
    for before_m, after_m, own_m, pushed_now in _heights(flight, time_s, ticks):
        if abs(after_m - before_m) > _ROUNDING_M:
            assert pushed_now
            assert abs(own_m - after_m) <= _HEIGHT_M + _ROUNDING_M
            assert (own_m - after_m) * (after_m - before_m) > 0.0, "it stays between where it was and the vehicle"
