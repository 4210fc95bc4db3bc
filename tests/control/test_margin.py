"""Margins measured through a law's step, against the loop worked out on paper and against what diverges."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from companion.control.controller import ControlInput, ControlOutput, VehicleModel
from companion.control.gains import PidGains
from companion.control.margin import TooLongError, Verdict, measure_margin
from companion.control.pid import Pid
from companion.core.types import Array

VEHICLE = VehicleModel(mocap_age_s=0.01)
RECORDED_1_KG = VehicleModel(
    mass_kg=1.0,
    gravity_mps2=9.8,
    attitude_bandwidth_radps=11.0,
    attitude_damping=0.99,
    thrust_lag_s=0.044,
    setpoint_delay_s=0.063,
    thrust_delay_s=0.01,
    mocap_age_s=0.01,
)
"""Result of `companion calibrate` for the SIH quadrotor of PX4 v1.17.0 in simulation, 2026-11-29."""
PERIOD_S = 0.01
OF_4_85_KG = PidGains.model_validate(
    {"kp_per_s2": [8.0, 8.0, 10.0], "ki_per_s3": [1.5, 1.5, 8.0], "kd_per_s": [10.0, 10.0, 13.0]}
)
"""The paper's newtons as if they were accelerations: on a vehicle of 1 kg they are."""


def on_paper(gains: PidGains, vehicle: VehicleModel) -> tuple[float, float, float]:
    """Phase margin (degrees), crossover (rad/s) and upper gain margin of PID along x, from its transfer function."""
    s = 1j * np.geomspace(0.5, 30.0, 20000)
    w, damping = vehicle.attitude_bandwidth_radps, vehicle.attitude_damping
    plant = w * w / (s * s + 2.0 * damping * w * s + w * w) / s**2
    held = (1.0 - np.exp(-s * PERIOD_S)) / (s * PERIOD_S)
    late = np.exp(-s * (vehicle.setpoint_delay_s + vehicle.mocap_age_s)) * held
    loop = (gains.kp_per_s2[0] + gains.ki_per_s3[0] / s + gains.kd_per_s[0] * s) * plant * late
    phase = np.unwrap(np.angle(loop))
    crossover = int(np.argmin(np.abs(np.log(np.abs(loop)))))
    turned = crossover + int(np.argmin(np.abs(phase[crossover:] - phase[crossover] + np.angle(-loop[crossover]))))
    return float(np.degrees(np.angle(-loop[crossover]))), float(s[crossover].imag), 1.0 / float(np.abs(loop[turned]))


@pytest.mark.parametrize("bandwidth_radps", [5.0, 7.7, 12.0])
def test_of_pid_they_are_those_of_its_transfer_function(bandwidth_radps: float) -> None:
    vehicle = replace(VEHICLE, attitude_bandwidth_radps=bandwidth_radps)
    phase_deg, crossover_radps, gain = on_paper(PidGains(), vehicle)
    margin = measure_margin(Pid(PidGains()), vehicle, PERIOD_S)
    assert margin.verdict is Verdict.MEASURED
    assert margin.axis == "x"
    assert margin.phase_deg == pytest.approx(phase_deg, abs=1.0)
    assert margin.crossover_radps == pytest.approx(crossover_radps, rel=0.03)
    assert margin.gain == pytest.approx(min(gain, 3.6), rel=0.05), "3.6: below it z's integral is no longer held"


def test_gains_of_a_heavy_vehicle_swing_a_light_one_as_the_real_autopilot_showed() -> None:
    """1.1 Hz and 10 to 14 degrees of tilt, PX4 v1.17.0 in simulation, SIH quadrotor of 1 kg."""
    margin = measure_margin(Pid(OF_4_85_KG), RECORDED_1_KG, PERIOD_S)
    assert margin.verdict is Verdict.SWINGS
    assert margin.swing_radps / (2.0 * np.pi) == pytest.approx(1.1, abs=0.1)
    assert measure_margin(Pid(PidGains()), RECORDED_1_KG, PERIOD_S).verdict is Verdict.MEASURED


@dataclass(frozen=True)
class Relay:
    """PD, and on top a hard sgn that never rests."""

    size_mps2: float
    preview_s: float = 0.0

    def initial(self, first: ControlInput) -> Any:  # noqa: ARG002
        return None

    def step(self, memory: Any, now: ControlInput) -> tuple[Any, ControlOutput]:
        error, rate = now.position_w_m - now.reference.position_w_m, now.velocity_w_mps - now.reference.velocity_w_mps
        sign: Array = np.sign(rate + error + 1e-6)
        accel = -1.6 * error - 2.0 * rate - self.size_mps2 * sign
        return memory, ControlOutput(accel, np.ones((*error.shape[:-1], 1)), {})


def test_what_never_rests_has_no_margin_to_measure() -> None:
    assert measure_margin(Relay(0.0), VEHICLE, PERIOD_S).verdict is Verdict.MEASURED
    assert measure_margin(Relay(0.15), VEHICLE, PERIOD_S).verdict is Verdict.CHATTERS
    assert measure_margin(Relay(4.0), VEHICLE, PERIOD_S).verdict is Verdict.SWINGS


def test_a_law_that_takes_too_long_is_given_up() -> None:
    with pytest.raises(TooLongError):
        measure_margin(Pid(PidGains()), VEHICLE, PERIOD_S, lambda: False)
