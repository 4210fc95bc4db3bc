"""Margins against virtual flights with estimator, noise and trigger: what is refused swings, what flies comes to rest.

Hover from 0.2 m away, without friction, which would hide a swing.
"""

from dataclasses import replace

import numpy as np
import pytest

from companion.config.controller_config import load_controller
from companion.config.law_margin import margin_of
from companion.control.controller import VehicleModel
from companion.estimation.estimator import EstimatorParams
from companion.simulation.mission import mission_of
from companion.simulation.simulation import Pilot, simulate
from companion.simulation.virtual_world import VirtualVehicle
from companion.trajectories.reference import Hold
from mock_autopilot.physics.plant import PlantParams

pytestmark = pytest.mark.slow

PERIOD_S = 0.01
VEHICLE = VehicleModel(mocap_age_s=0.01)
NOTHING = (0.0, 0.0, 0.0)


def swing_m(name: str, told: VehicleModel, delay_s: float) -> float:
    """Amplitude along x in the last 4 s of 16 s, on a vehicle as told but for its setpoint delay."""
    law = load_controller(name, told, PERIOD_S).law
    radps, damping = told.attitude_bandwidth_radps, told.attitude_damping
    plant = PlantParams(
        attitude_bandwidth_radps=(radps, radps, 3.0),
        attitude_damping=(damping, damping, 0.6),
        torque_lag_s=NOTHING,
        viscous_npm=NOTHING,
        quadratic_npm2=NOTHING,
        coulomb_n=NOTHING,
    )
    away = np.array([0.2, -0.2, 0.0])
    vehicle = VirtualVehicle(
        plant=plant,
        mocap_delay_s=told.mocap_age_s,
        attitude_delay_s=delay_s,
        thrust_delay_s=told.thrust_delay_s,
        offset_w_m=away,
    )
    mission = mission_of(Hold(np.array([0.0, 0.0, 1.2]), 0.0), law.preview_s, 16.0, PERIOD_S)
    pilot = Pilot(law=law, estimator=EstimatorParams(delay_s=told.mocap_age_s), period_s=PERIOD_S)
    end_m = simulate(pilot, vehicle, mission, [1]).error_w_m[-400:, 0]
    return float(np.ptp(end_m)) / 2.0


@pytest.mark.parametrize(
    ("name", "bandwidth_radps", "enough", "least_m", "most_m"),
    [
        ("practical", 3.6, False, 0.1, np.inf),
        ("practical", 5.0, False, 0.018, 0.06),
        ("practical", 7.7, True, 0.0, 0.0125),
        ("practical", 20.0, True, 0.0, 0.0125),
        ("pid", 3.0, False, 0.04, 0.2),
        ("pid", 7.7, True, 0.0, 0.005),
    ],
)
def test_the_margin_tells_what_swings(
    name: str, bandwidth_radps: float, enough: bool, least_m: float, most_m: float
) -> None:
    vehicle = replace(VEHICLE, attitude_bandwidth_radps=bandwidth_radps)
    assert margin_of(load_controller(name, vehicle, PERIOD_S), vehicle, PERIOD_S).enough is enough
    assert least_m <= swing_m(name, vehicle, vehicle.setpoint_delay_s) <= most_m


def test_the_phase_margin_is_the_delay_that_may_be_added() -> None:
    """PID: 37 degrees at 2.1 rad/s are 0.31 s."""
    assert swing_m("pid", VEHICLE, VEHICLE.setpoint_delay_s + 0.25) < 0.05
    assert swing_m("pid", VEHICLE, VEHICLE.setpoint_delay_s + 0.37) > 0.2
