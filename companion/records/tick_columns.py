"""Columns recorded of a tick: names of its parts, and their values in the same order."""

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from companion.core.types import Array
from companion.estimation.state import Counts
from companion.flight.tick import Tick
from companion.records import others
from companion.records.split.link_columns import LINK, link_accel, link_numbers

F64 = np.dtype(np.float64)
_WANTED = "accel_w_mps2"

Shape = tuple[int, ...]
Column = tuple[str, str, Shape]
"""Topic, name, and shape: () for a number."""

# Topic, names of its numbers, names of its arrays; the functions below give the values in the same order.
_BASE = {
    "/flight": ("time_s late_s age_s sent_s airborne touched_down since_s theirs level takeoff_height_m", ""),
    "/autopilot": (
        "connected heartbeat_s armed in_air battery_fraction battery_v heard_s attitude_s boot_s failsafe velocity_s",
        "autopilot_q_w_flu_wxyz autopilot_rate_flu_radps autopilot_velocity_w_mps",
    ),
}
_FRAME = {
    "/mocap": (
        "frame_number frame_stamp_s frame_received_s frame_residual_m frame_late",
        "frame_position_w_m frame_rotation_w_b",
    )
}
_GROUND_POSE = {"/ground_pose": ("ground_pose_s ground_pose_yaw_rad", "ground_pose_position_w_m")}
_ESTIMATE = {
    "/estimate": (
        "estimate_run estimate_agreeing estimate_stamp_s estimate_clock_offset_s "
        + " ".join(f"estimate_{count.name}" for count in fields(Counts)),
        "",
    )
}
_VEHICLE = {"/estimate": ("vehicle_time_s", "position_w_m velocity_w_mps q_w_flu_wxyz rate_flu_radps")}
_REFERENCE = {
    "/reference": (
        "reference_yaw_rad",
        "reference_position_w_m reference_velocity_w_mps reference_acceleration_w_mps2",
    )
}
_PIPELINE = {
    "/given": (
        "given_age_s given_reference_yaw_rad given_dt_s begun",
        "given_position_w_m given_velocity_w_mps given_q_w_flu_wxyz given_rate_flu_radps "
        "given_reference_position_w_m given_reference_velocity_w_mps given_reference_acceleration_w_mps2 "
        "given_sent_accel_w_mps2 given_known_accel_w_mps2",
    ),
    "/law": ("event", ""),
}
_LIMITED = {
    "/setpoint": (
        "setpoint_thrust cut_not_finite cut_tilt cut_thrust cut_slew cut_age cut_fence cut_separation",
        "setpoint_q_w_flu_wxyz",
    )
}
_WIRE = {
    "/horizon": (
        "wire_thrust wire_is_new horizon_off_roll_rad horizon_off_pitch_rad horizon_roll_rad horizon_pitch_rad "
        "horizon_autopilot_age_s horizon_trusted horizon_flying horizon_dt_s horizon_begun",
        "wire_q_w_flu_wxyz wire_last_q_w_flu_wxyz horizon_autopilot_q_w_flu_wxyz",
    )
}
_ARMS = {
    "/arms": (
        "arm_bus_cycles arm_bus_cycle_s arm_bad_packets",
        "joint_read_s joint_position_rad joint_velocity_radps joint_effort joint_temperature_c joint_voltage_v "
        "joint_torque_on joint_held_rad arms_known_accel_w_mps2",
    )
}
_GOAL = {"/arms": ("", "joint_goal_rad joint_goal_velocity_radps joint_goal_acceleration_radps2")}


@dataclass(frozen=True)
class Signals:
    """The law's output and internal signals in one block of bytes."""

    columns: tuple[Any, ...]
    """Their names, then the shape of each."""
    block: bytes


Frozen = tuple[list[Array], bytes]
"""Arrays, of which only type and shape still count, and what was in them."""


@dataclass
class Values:
    """Numbers and arrays of one tick, with the names of its parts."""

    parts: list[dict[str, tuple[str, str]]] = field(default_factory=list)
    numbers: list[Any] = field(default_factory=list)
    arrays: list[Array] = field(default_factory=list)


def gathered(tick: Tick) -> Values:
    """Return numbers and arrays of all parts that this tick has, named by the tables above."""
    status, flight = tick.status, tick.flight
    parts = [_BASE]
    numbers: list[Any] = [
        tick.time_s, tick.late_s, tick.age_s, tick.sent_s, flight.airborne, flight.touched_down, flight.since_s,
        flight.theirs, flight.level, flight.takeoff_height_m,
        status.connected, status.heartbeat_s, status.armed, status.in_air, status.battery_fraction, status.battery_v,
        status.heard_s, status.attitude_s, status.boot_s, status.failsafe, status.velocity_s,
    ]  # fmt: skip
    arrays = [status.q_w_flu_wxyz, status.rate_flu_radps, status.velocity_w_mps]
    if (frame := tick.frame) is not None:
        parts.append(_FRAME)
        numbers += (frame.frame, frame.stamp_s, frame.received_s, frame.residual_m, frame.late)
        arrays += (frame.position_w_m, frame.rotation_w_b)
    if (pose := tick.ground_pose) is not None:
        parts.append(_GROUND_POSE)
        numbers += (pose.time_s, pose.yaw_rad)
        arrays.append(pose.position_w_m)
    if (estimate := tick.estimate) is not None:
        parts.append(_ESTIMATE)
        numbers += (estimate.run, estimate.agreeing, estimate.stamp_s, estimate.clock.offset_s)
        numbers += vars(estimate.counts).values()
    if (vehicle := tick.vehicle) is not None:
        parts.append(_VEHICLE)
        numbers.append(vehicle.time_s)
        arrays += (vehicle.position_w_m, vehicle.velocity_w_mps, vehicle.q_w_flu_wxyz, vehicle.rate_flu_radps)
    others.gather(tick.frame, tick.vehicle, parts, arrays)
    if (reference := tick.reference) is not None:
        parts.append(_REFERENCE)
        numbers.append(reference.yaw_rad)
        arrays += (reference.position_w_m, reference.velocity_w_mps, reference.acceleration_w_mps2)
    if (output := tick.pipeline) is not None:
        parts.append(_PIPELINE)
        given, ahead = output.given, output.given.reference
        numbers += (given.age_s, ahead.yaw_rad, given.dt_s, output.begun, bool(output.law_output.event.any()))
        arrays += (
            given.position_w_m, given.velocity_w_mps, given.q_w_flu_wxyz, given.rate_flu_radps,
            ahead.position_w_m, ahead.velocity_w_mps, ahead.acceleration_w_mps2,
            given.sent_accel_w_mps2, given.known_accel_w_mps2,
        )  # fmt: skip
    if (limited := tick.limited) is not None:
        parts.append(_LIMITED)
        numbers += (
            limited.setpoint.thrust, limited.not_finite, limited.tilt_cut, limited.thrust_cut, limited.slew_cut,
            limited.age_cut, limited.fence_cut, limited.separation_cut,
        )  # fmt: skip
        arrays.append(limited.setpoint.q_w_flu_wxyz)
    if (wire := tick.wire) is not None:
        parts.append(_WIRE)
        horizon, seen = wire.horizon, wire.inputs
        numbers += (
            wire.setpoint.thrust, wire.is_new, horizon.off_x, horizon.off_y, horizon.x, horizon.y,
            seen.autopilot_age_s, seen.trusted, seen.flying, wire.dt_s, wire.begun,
        )  # fmt: skip
        arrays += (wire.setpoint.q_w_flu_wxyz, wire.last.q_w_flu_wxyz, seen.autopilot_q_w_flu_wxyz)
    if tick.link is not None:
        parts.append(LINK)
        numbers += link_numbers(tick.link)
        arrays.append(link_accel(tick.link))
    if tick.arms is not None:
        _gather_arms(tick, parts, numbers, arrays)
    for more in tick.more:
        parts.append(more.names)
        numbers += more.numbers
        arrays += more.arrays
    return Values(parts, numbers, arrays)


def _gather_arms(tick: Tick, parts: list[Any], numbers: list[Any], arrays: list[Array]) -> None:
    assert tick.arms is not None
    status, goal = tick.arms.status, tick.arms.goal
    parts.append(_ARMS)
    numbers += (status.cycles, status.cycle_s, status.bad_packets)
    arrays += (
        status.read_s, status.position_rad, status.velocity_radps, status.effort, status.temperature_c,
        status.voltage_v, status.torque_on.astype(F64), status.held_rad, tick.arms.known_accel_w_mps2,
    )  # fmt: skip
    if goal is not None:
        parts.append(_GOAL)
        arrays += (goal.position_rad, goal.velocity_radps, goal.acceleration_radps2)


def frozen(tick: Tick) -> Frozen:
    """Copy the bytes of the law's output and signals, of every tick: a user's law may write into its arrays later."""
    output = tick.pipeline
    if output is None:
        arrays = [*tick.late_signals.values()]
    else:
        arrays = [output.law_output.accel_w_mps2, *output.law_output.signals.values(), *tick.late_signals.values()]
    try:
        return arrays, b"".join(arrays)  # type: ignore[arg-type]
    except TypeError:  # not one piece of memory, or what a user's law calls an array
        arrays = [_array(array) for array in arrays]
        return arrays, b"".join(arrays)  # type: ignore[arg-type]


def _array(signal: Any) -> Array:
    """Return a contiguous float64 array; NaN where it is no number."""
    try:
        return np.array(signal, F64, order="C")
    except (TypeError, ValueError):
        return np.array(math.nan)


def signals_of(tick: Tick, kept: Frozen) -> Signals:
    """Return the names, shapes and float64 block of `frozen` values, for a row."""
    arrays, block = kept
    names = (*tick.late_signals,)
    if tick.pipeline is not None:
        names = (_WANTED, *tick.pipeline.law_output.signals, *names)
    if any(array.dtype is not F64 and array.dtype != F64 for array in arrays):
        arrays, block = _as_f64(arrays, block)
    return Signals((names, *[array.shape for array in arrays]), block)


def _as_f64(arrays: list[Array], block: bytes) -> Frozen:
    """Convert arrays to float64: a user's law may have integers or short floats."""
    copies, at = [], 0
    for array in arrays:
        piece = block[at : at + array.nbytes]
        at += array.nbytes
        if array.dtype.kind in "fiub":
            copies.append(np.frombuffer(piece, array.dtype).astype(F64).reshape(array.shape))
        else:
            copies.append(np.array(math.nan))
    return copies, b"".join(copies)  # type: ignore[arg-type]


def columns_of(values: Values, signals: Signals) -> list[Column]:
    """Return the columns of a row: numbers first, then arrays, in the order in which they were gathered."""
    numbers: list[Column] = []
    arrays: list[tuple[str, str]] = []
    for part in values.parts:
        for topic, (of_numbers, of_arrays) in part.items():
            numbers += [(topic, name, ()) for name in of_numbers.split()]
            arrays += [(topic, name) for name in of_arrays.split()]
    if len(numbers) != len(values.numbers):
        raise ValueError(f"{len(values.numbers)} numbers of a tick have {len(numbers)} names")
    shaped = [(topic, name, array.shape) for (topic, name), array in zip(arrays, values.arrays, strict=True)]
    names, *shapes = signals.columns
    columns = [_column_of(name) for name in names]
    return numbers + shaped + [("/law", column, shape) for column, shape in zip(columns, shapes, strict=True)]


def _column_of(signal: str) -> str:
    """Return the column of a law's signal; `law_name` is taken by the law's own name."""
    if signal == _WANTED:
        return signal
    return "law_name_" if signal == "name" else f"law_{signal}"
