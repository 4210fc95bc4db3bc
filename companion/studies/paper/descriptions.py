"""Descriptions of an experiment in words: sizes, speeds, arms, room and vehicle."""

import math

import numpy as np

from companion.arms.model import CHAIN, JOINTS_PER_ARM, KINDS
from companion.config.arms_config import Feedforward
from companion.core.paper_vehicle import GRAVITY_MPS2
from companion.core.types import Array
from companion.simulation.scene import Scene, arm_feedforward_b_mps2
from companion.simulation.virtual_link import words_of
from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.physics.disturbance import Sinusoid

Facts = tuple[tuple[str, str], ...]


def facts_of(scene: Scene) -> Facts:
    """Pairs of a heading and what is to be said under it."""
    ground = () if scene.radio is None else (("the law", _law(scene, scene.radio)),)
    return (
        ("trajectory", _trajectory(scene)),
        ("arms", _arms(scene)),
        ("vehicle", _vehicle(scene)),
        ("measurement", _measurement(scene)),
        ("the autopilot's horizon", _horizon(scene)),
        ("room", _room(scene)),
        ("what the companion is told", _told(scene)),
        *ground,
    )


def _law(scene: Scene, radio: Directions) -> str:
    return (
        f"on the ground, over a radio with {words_of(radio)}; its commands are {1e3 * scene.up_age_s:.0f} ms old when "
        "they are used, for which it is made"
    )


def _trajectory(scene: Scene) -> str:
    now = scene.mission(0.0).now
    low, high = now.position_w_m.min(axis=0), now.position_w_m.max(axis=0)
    x, y, z = (high - low).tolist()
    speed, accel = (_largest_norm(some) for some in (now.velocity_w_mps, now.acceleration_w_mps2))
    climb = "at constant height" if z < 1e-9 else f"over {z:.2f} m of height"
    return (
        f"{x:.2f} m along x, {y:.2f} m along y, {climb} ({low[2]:.2f} m), {scene.trajectory.duration_s:.0f} s from "
        f"rest to rest; up to {speed:.2f} m/s and {accel:.2f} m/s²; {scene.settle_s:.0f} s of hover before it do not "
        "count"
    )


def _arms(scene: Scene) -> str:
    if scene.arms is None or scene.companion.arms is None:
        return "none"
    time_s = np.arange(0.0, scene.settle_s + scene.trajectory.duration_s, scene.period_s)
    moved = scene.arms.trajectory.at(time_s)
    late = time_s >= scene.settle_s
    degrees, fastest = np.degrees(moved.position_rad[late]), np.abs(moved.velocity_radps[late]).max()
    ranges = ", ".join(f"{KINDS[joint].replace('_', ' ')} {_range(degrees, joint)}" for joint in range(CHAIN))
    arms = scene.companion.arms.model_copy(update={"feedforward": Feedforward.FULL})
    push = arm_feedforward_b_mps2(scene.companion, arms, scene.arms.trajectory, time_s)[late]
    return (
        f"both swing: {ranges}, up to {fastest:.2f} rad/s; through force and tilt they push the vehicle by up to "
        f"{_largest_norm(push):.2f} m/s²"
    )


def _range(degrees: Array, joint: int) -> str:
    both = degrees[:, [joint, joint + JOINTS_PER_ARM]]
    return f"{both.min():.0f}° to {both.max():.0f}°"


def _vehicle(scene: Scene) -> str:
    plant, own = scene.mock.plant, scene.mock.vehicle
    roll, pitch, yaw = np.broadcast_to(plant.attitude_bandwidth_radps, 3).tolist()
    damping = np.broadcast_to(plant.attitude_damping, 3).tolist()
    return (
        f"{plant.mass_kg:g} kg; attitude loop of second order, {roll:g}, {pitch:g} and {yaw:g} rad/s about roll, pitch "
        f"and yaw, damping {damping[0]:g}; rotors' lag {1e3 * float(plant.thrust_lag_s):.0f} ms; setpoints reach the "
        f"attitude loop after {1e3 * own.attitude_delay_s:.0f} ms, the rotors after {1e3 * own.thrust_delay_s:.0f} ms; "
        f"friction {_triple(plant.viscous_npm)} N/(m/s) viscous, {_triple(plant.quadratic_npm2)} N/(m/s)² quadratic, "
        f"{_triple(plant.coulomb_n)} N dry"
    )


def _measurement(scene: Scene) -> str:
    seen = scene.mock.qualisys
    return (
        f"motion capture at {scene.companion.control.rate_hz:g} Hz, {1e3 * seen.delay_s:.0f} ms old, noise "
        f"{1e3 * seen.noise_m:.2f} mm an axis and {1e3 * seen.noise_rad:.1f} mrad"
    )


def _horizon(scene: Scene) -> str:
    error = scene.vehicle().attitude_error
    if not error.present:
        return "without error"
    size_deg = math.degrees(float(np.mean(error.rms_rad)))
    kind = f"slowly (1/e after {error.time_s:g} s)" if error.source == "random" else f"as recorded in {error.source}"
    corrected = "corrected" if scene.corrects else "not corrected"
    return f"off by {size_deg:.1f}° (RMS of roll and of pitch), {kind}; {corrected} by the companion"


def _room(scene: Scene) -> str:
    room = scene.mock.disturbance
    waves = "; ".join(_wave(wave) for wave in room.sinusoids)
    steady = np.array(room.constant_ned_n)
    weight_n = float(scene.mock.plant.mass_kg) * GRAVITY_MPS2
    strongest = _norm(np.abs(steady) + sum((np.abs(wave.amplitude_ned_n) for wave in room.sinusoids), np.zeros(3)))
    return (
        f"a steady push of {_triple(steady)} N (north, east, down){'; ' + waves if waves else ''}; and a random one of "
        f"{_triple(room.noise_n)} N that forgets within {room.noise_time_s:g} s. Without the random part at most "
        f"{strongest:.1f} N, {strongest / weight_n:.1%} of the weight"
    )


def _wave(wave: Sinusoid) -> str:
    return f"{_triple(wave.amplitude_ned_n)} N with a period of {wave.period_s:g} s"


def _told(scene: Scene) -> str:
    v = scene.companion.vehicle
    arms = scene.companion.arms
    told = "of no arms" if arms is None else f"of the arms' commanded motion: {arms.feedforward}"
    return (
        f"{v.mass_kg:g} kg, attitude loop {v.attitude_bandwidth_radps:g} rad/s with damping {v.attitude_damping:g}, "
        f"delays {1e3 * scene.companion.mocap.delay_s:.0f} ms in and {1e3 * v.setpoint_delay_s:.0f} ms out; {told}"
    )


def _triple(values: object) -> str:
    return "/".join(f"{value:g}" for value in np.broadcast_to(np.asarray(values, dtype=float), 3))


def _largest_norm(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1)).max())


def _norm(vector: Array) -> float:
    return math.hypot(*vector.tolist())
