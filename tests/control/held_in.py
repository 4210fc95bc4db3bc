"""A hostile flight: one setpoint is commanded for ever, and only the guard limits it."""

import math
from dataclasses import dataclass

import numpy as np

from companion.core.types import Array, AttitudeThrust, VehicleState
from companion.geometry.frames import flip_quat, flip_yz, quat_from_yaw
from companion.guard.geofence import Fence
from companion.guard.guard import Guard
from mock_autopilot.physics import plant_one
from mock_autopilot.physics.plant import GRAVITY_MPS2, PlantParams
from mock_autopilot.physics.plant_one import OneActuation, OneState

DT_S = 0.01
DELAY_CYCLES = 4
"""Delay from the state to the autopilot: 40 ms."""
NOTHING = (0.0, 0.0, 0.0)
PLANT = PlantParams(
    attitude_bandwidth_radps=(7.7, 7.7, 2.7), viscous_npm=NOTHING, quadratic_npm2=NOTHING, coulomb_n=NOTHING
)
"""Nothing but its thrust slows the vehicle down."""


@dataclass(frozen=True)
class Held:
    """Trace of the flight, one row per cycle."""

    beyond_m: Array
    fence_cut: Array
    position_w_m: Array


def pressed(
    guard: Guard, fence: Fence, wanted: AttitudeThrust, start: tuple[Array, Array, float], for_s: float = 3.0
) -> Held:
    """Fly from level flight at a position (m), velocity (m/s) and heading (rad) in W."""
    position, velocity, yaw_rad = start
    q = quat_from_yaw(yaw_rad)
    fixed, weight_n = plant_one.fixed_of(PLANT, 0.5 * DT_S), float(PLANT.mass_kg) * GRAVITY_MPS2
    state = OneState(
        position_ned_m=_three(flip_yz(position)),
        velocity_ned_mps=_three(flip_yz(velocity)),
        q_ned_frd_wxyz=_four(flip_quat(q)),
        rate_frd_radps=NOTHING,
        thrust_n=weight_n,
        acceleration_ned_mps2=NOTHING,
        on_ground=False,
        turn_frd_radps2=NOTHING,
    )
    sent = [AttitudeThrust(q, np.array(0.5))] * (DELAY_CYCLES + 1)
    beyond, cut, places = [], [], []
    for _ in range(math.ceil(for_s / DT_S)):
        place, attitude = flip_yz(np.array(state.position_ned_m)), flip_quat(np.array(state.q_ned_frd_wxyz))
        vehicle = VehicleState(0.0, place, flip_yz(np.array(state.velocity_ned_mps)), attitude, np.zeros(3))
        limited = guard.check(wanted, sent[-1], vehicle, 0.0, DT_S)
        sent = [*sent[1:], limited.setpoint]
        asked = OneActuation(_four(flip_quat(sent[0].q_w_flu_wxyz)), float(sent[0].thrust))
        for _ in range(2):
            state = plant_one.moved(state, asked, NOTHING, NOTHING, fixed)
        beyond.append(fence.beyond_m(place))
        cut.append(bool(limited.fence_cut))
        places.append(place)
    return Held(np.array(beyond), np.array(cut), np.array(places))


def _three(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _four(q: Array) -> tuple[float, float, float, float]:
    w, x, y, z = q.tolist()
    return w, x, y, z
