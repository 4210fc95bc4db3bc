"""The correction as a transfer function (docs/horizon.md): no loop where the clocks agree, else a weak one.

Let e be the horizon's error, G the autopilot's closed attitude loop with its delay, F the low pass. The autopilot
brings its own belief a to the setpoint w, the true tilt is a + e, and the difference of the two is e whatever w is. So
w = r - F e and the tilt is G r + (1 - G F) e: nothing comes back to w. A time error of d between the two attitudes
adds (exp(-s d) - 1) a to the difference, which does: loop gain G F (exp(-s d) - 1). So does motion capture's filter.
"""

from itertools import product

import numpy as np
import pytest

from companion.control.horizon_correction import TIME_CONSTANT_S
from tests.flights.command import ROOT

PAGE = ROOT / "docs" / "horizon.md"
OMEGA = np.geomspace(0.01, 300.0, 6000)
S = 1j * OMEGA
DELAY_S = 0.04
"""Setpoint to attitude."""
AGE_S = 0.08
"""Age of the corrected error: transport, and half the mean time between the law's setpoints."""
BANDWIDTHS_RADPS = (6.3, 10.0)
TIME_CONSTANTS_S = (0.2, 0.3, 0.5, 1.0, 2.0)
CORRELATION_S = (2.5, 5.0, 20.0)

Complex = np.ndarray


def attitude_loop(bandwidth_radps: float, damping: float = 0.8) -> Complex:
    lag = bandwidth_radps**2 / (S**2 + 2.0 * damping * bandwidth_radps * S + bandwidth_radps**2)
    return np.asarray(lag * np.exp(-S * DELAY_S))


def low_pass(time_constant_s: float) -> Complex:
    return np.asarray(1.0 / (1.0 + time_constant_s * S))


def left(bandwidth_radps: float, time_constant_s: float) -> Complex:
    """Tilt error that is left of the horizon's error."""
    return np.asarray(1.0 - attitude_loop(bandwidth_radps) * low_pass(time_constant_s) * np.exp(-S * AGE_S))


def timing_gain(bandwidth_radps: float, time_constant_s: float, late_s: float) -> float:
    loop = attitude_loop(bandwidth_radps) * low_pass(time_constant_s) * (np.exp(-S * late_s) - 1.0)
    return float(np.abs(loop).max())


def filter_gain(bandwidth_radps: float, time_constant_s: float) -> float:
    """Return the gain of motion capture's attitude filter, poles at 35 rad/s, without lag in a steady turn."""
    behind = S**2 / (S**2 + 1.4 * 35.0 * S + 35.0**2)
    return float(np.abs(attitude_loop(bandwidth_radps) * low_pass(time_constant_s) * behind).max())


def rms_left(bandwidth_radps: float, time_constant_s: float, correlation_s: float) -> float:
    """Share of the rms of an error that forgets in this time (Ornstein-Uhlenbeck)."""
    power = 1.0 / (1.0 + (OMEGA * correlation_s) ** 2)
    passed = power * np.abs(left(bandwidth_radps, time_constant_s)) ** 2
    return float(np.sqrt(np.trapezoid(passed, OMEGA) / np.trapezoid(power, OMEGA)))


@pytest.mark.parametrize(("bandwidth_radps", "time_constant_s"), [*product(BANDWIDTHS_RADPS, TIME_CONSTANTS_S)])
def test_attitudes_20_ms_apart_make_a_loop_far_below_one(bandwidth_radps: float, time_constant_s: float) -> None:
    """Small gain: stable whatever the phase, with 23 dB at least."""
    assert timing_gain(bandwidth_radps, time_constant_s, 0.02) < 0.07
    assert filter_gain(bandwidth_radps, time_constant_s) < 0.03


def test_the_law_loses_hardly_any_phase_to_it() -> None:
    """The law's setpoint reaches the tilt by G / (1 + L) instead of G: under 3 degrees and 0.5 dB at any frequency."""
    loop = attitude_loop(10.0) * low_pass(TIME_CONSTANT_S) * (np.exp(-S * 0.02) - 1.0)
    assert np.degrees(np.abs(np.angle(1.0 / (1.0 + loop)))).max() < 3.0
    assert 20.0 * np.abs(np.log10(np.abs(1.0 + loop))).max() < 0.5


def test_quick_errors_grow_by_little() -> None:
    assert np.abs(left(10.0, TIME_CONSTANT_S)).max() < 1.45
    assert np.abs(left(10.0, TIME_CONSTANT_S))[OMEGA < 0.2].max() < 0.2


def row(time_constant_s: float) -> str:
    shares = [f"{rms_left(10.0, time_constant_s, correlation_s):.2f}" for correlation_s in CORRELATION_S]
    peak = np.abs(left(10.0, time_constant_s)).max()
    gain_db = 20.0 * np.log10(timing_gain(10.0, time_constant_s, 0.02))
    return f"| {time_constant_s:g} | {' | '.join(shares)} | {peak:.2f} | {gain_db:.0f} dB |"


@pytest.mark.parametrize("time_constant_s", TIME_CONSTANTS_S)
def test_the_page_has_these_numbers(time_constant_s: float) -> None:
    assert row(time_constant_s) in PAGE.read_text(encoding="utf-8"), row(time_constant_s)
