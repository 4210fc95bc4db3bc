"""Vehicles and rooms drawn at random around what the companion is told of them.

Vehicle i of a seed is the same whatever the number of vehicles: each draws from a random sequence of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array
from companion.simulation.scene import Scene
from companion.simulation.virtual_world import STEP_S, VirtualVehicle
from mock_autopilot.impairment.model import Impairment
from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.physics.plant import GRAVITY_MPS2, thrust_of_signal
from mock_autopilot.px4.attitude_error import AttitudeErrorParams

Range = tuple[float, float]

MASS_SHARE: Range = (0.8, 1.2)
"""True mass over the one the companion is told."""
HOVER_SHARE: Range = (0.85, 1.15)
"""True hover thrust over the one it is told."""
BANDWIDTH_SHARE: Range = (0.7, 1.3)
"""True bandwidth of the attitude loop over the scene's, all three axes alike."""
DELAY_STEPS = (2, 8)
"""True delays, each way, in steps of STEP_S: 10 to 40 ms."""
DISTURBANCE_SCALE: Range = (0.5, 1.5)
NOISE_SCALE: Range = (0.5, 3.0)
"""Motion capture's noise over the scene's."""
OFFSET_M: Range = (0.0, 0.5)
"""Distance from the trajectory's start at which a flight begins, in any direction."""
DROPOUTS = 6
"""Times that motion capture loses the vehicle in one flight, at most."""
DROPOUT_S: Range = (0.01, 0.1)
ATTITUDE_ERROR_RAD: Range = (0.005, 0.035)
"""RMS error of the autopilot's roll and pitch: 0.3 to 2 degrees."""
ATTITUDE_ERROR_TIME_S: Range = (1.0, 20.0)
"""Its correlation time."""
RADIO_SHARE: Range = (0.5, 1.5)
"""Loss, delay and jitter of the radio to a law on the ground over those of the link it was made for."""
CLEAR_M = 0.5
"""A flight that would begin lower than this begins above the trajectory's start instead of below it."""

_SINGLE = 11
"""Random numbers of a vehicle, those of its drop-outs apart."""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Random parameters of N vehicles, each array (N, ...)."""

    flight_seed: NDArray[np.uint64]
    """Seed of the noise of motion capture and of the disturbance."""
    mass_share: Array
    hover_share: Array
    bandwidth_share: Array
    mocap_delay_s: Array
    """Capture to arrival."""
    setpoint_delay_s: Array
    """Setpoint sent to the attitude loop, and to the rotors."""
    disturbance_scale: Array
    noise_scale: Array
    offset_w_m: Array
    """(N, 3)"""
    dropout_s: Array
    """Length of each drop-out, (N, DROPOUTS); 0 for one that does not happen."""
    dropout_begin: Array
    """When in its own part of the flight each begins, 0..1, (N, DROPOUTS)."""
    attitude_error_rad: Array
    attitude_error_time_s: Array
    radio_share: Array
    """Shares of loss, delay and jitter, (N, 3)."""


def draw(seed: int, indices: Sequence[int]) -> Drawn:
    """The vehicles of these indices: independent, uniform in the ranges above."""
    sequences = [np.random.SeedSequence(seed, spawn_key=(index,)).spawn(2) for index in indices]
    u = np.array([np.random.default_rng(own).random(_SINGLE + 2 * DROPOUTS + 5) for own, _ in sequences])
    first, last = DELAY_STEPS
    delay_s = STEP_S * (first + np.floor(u[:, 3:5] * (last - first + 1)))
    happens = np.arange(DROPOUTS) < np.floor(u[:, 10:_SINGLE] * (DROPOUTS + 1))
    length, begin = (u[:, _SINGLE + part * DROPOUTS :][:, :DROPOUTS] for part in range(2))
    return Drawn(
        flight_seed=np.array([flight.generate_state(1, np.uint64)[0] for _, flight in sequences]),
        mass_share=_between(MASS_SHARE, u[:, 0]),
        hover_share=_between(HOVER_SHARE, u[:, 1]),
        bandwidth_share=_between(BANDWIDTH_SHARE, u[:, 2]),
        mocap_delay_s=delay_s[:, 0],
        setpoint_delay_s=delay_s[:, 1],
        disturbance_scale=_between(DISTURBANCE_SCALE, u[:, 5]),
        noise_scale=_between(NOISE_SCALE, u[:, 6]),
        offset_w_m=_offset_w_m(u[:, 7:10]),
        dropout_s=np.where(happens, _between(DROPOUT_S, length), 0.0),
        dropout_begin=begin,
        attitude_error_rad=_between(ATTITUDE_ERROR_RAD, u[:, -5]),
        attitude_error_time_s=_between(ATTITUDE_ERROR_TIME_S, u[:, -4]),
        radio_share=_between(RADIO_SHARE, u[:, -3:]),
    )


def _between(ends: Range, u: Array) -> Array:
    return np.asarray(ends[0] + u * (ends[1] - ends[0]))


def _offset_w_m(u: Array) -> Array:
    """Every direction as likely, (N, 3)."""
    up, around = 2.0 * u[:, 0] - 1.0, 2.0 * np.pi * u[:, 1]
    across = np.sqrt(1.0 - up * up)
    direction = np.stack((across * np.cos(around), across * np.sin(around), up), axis=-1)
    return np.asarray(direction * _between(OFFSET_M, u[:, 2])[:, None])


def radios(radio: Directions, drawn: Drawn) -> tuple[Directions, ...]:
    """Return the radio of every vehicle (N,), both directions alike."""
    return tuple(Directions(_scaled(radio.up, share), _scaled(radio.down, share)) for share in drawn.radio_share)


def _scaled(one: Impairment, share: Array) -> Impairment:
    loss, delay, jitter = share.tolist()
    return replace(
        one,
        loss_share=min(loss * one.loss_share, 1.0),
        burst_share=min(loss * one.burst_share, 1.0),
        delay_s=delay * one.delay_s,
        jitter_s=jitter * one.jitter_s,
    )


def unseen(drawn: Drawn, cycles: int, period_s: float) -> NDArray[np.bool_]:
    """Return the lost frames, (cycles, N): not the first one, and no two drop-outs join to a longer one.

    Each drop-out has its own part of the flight, from `cycles` / DROPOUTS cycles a part to the next.
    """
    edges = np.linspace(0, cycles, DROPOUTS + 1).astype(np.int64)
    length = np.where(drawn.dropout_s > 0.0, np.maximum(np.rint(drawn.dropout_s / period_s), 1.0), 0.0)
    room = np.maximum(np.diff(edges) - 1 - length, 0.0)
    first = edges[:-1] + 1 + np.floor(drawn.dropout_begin * (room + 1.0))
    last = np.minimum(first + length, edges[1:])
    cycle = np.arange(cycles)[:, None]
    lost = np.zeros((cycles, len(length)), dtype=bool)
    for part in range(DROPOUTS):
        lost |= (cycle >= first[:, part]) & (cycle < last[:, part])
    return lost


def vehicles(scene: Scene, drawn: Drawn, cycles: int) -> VirtualVehicle:
    """The drawn vehicles (N,) in the scene's room, for a flight of so many cycles. The companion believes the scene."""
    base, told = scene.vehicle(), scene.companion.vehicle
    mass_kg, hover_thrust = told.mass_kg * drawn.mass_share, told.hover_thrust * drawn.hover_share
    lift_share = thrust_of_signal(hover_thrust, replace(base.plant, max_thrust_n=1.0))
    plant = replace(
        base.plant,
        mass_kg=mass_kg,
        max_thrust_n=mass_kg * GRAVITY_MPS2 / lift_share,
        attitude_bandwidth_radps=np.asarray(base.plant.attitude_bandwidth_radps) * drawn.bandwidth_share[:, None],
    )
    return replace(
        base,
        plant=plant,
        mocap_delay_s=drawn.mocap_delay_s,
        attitude_delay_s=drawn.setpoint_delay_s,
        thrust_delay_s=drawn.setpoint_delay_s,
        noise_m=base.noise_m * drawn.noise_scale,
        noise_rad=base.noise_rad * drawn.noise_scale,
        force_scale=drawn.disturbance_scale,
        attitude_error=_attitude_error(base.attitude_error, drawn),
        offset_w_m=_off_the_floor(drawn.offset_w_m, float(scene.trajectory.at(0.0).position_w_m[2])),
        unseen=unseen(drawn, cycles, scene.period_s),
    )


def _attitude_error(base: AttitudeErrorParams, drawn: Drawn) -> AttitudeErrorParams:
    """Return a random error for each vehicle, unless the scene's horizon is perfect."""
    if not base.present:
        return base
    return AttitudeErrorParams(size_rad=drawn.attitude_error_rad, time_s=drawn.attitude_error_time_s)


def _off_the_floor(offset_w_m: Array, height_m: float) -> Array:
    up_m = offset_w_m[:, 2:]
    return np.concatenate((offset_w_m[:, :2], np.where(height_m + up_m < CLEAR_M, np.abs(up_m), up_m)), axis=-1)
