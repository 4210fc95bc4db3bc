"""Columns of the other vehicles: their positions in a frame, and their motion as guard and supervisor know it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from companion.core.types import Array, MocapFrame, OtherBody, OtherVehicle, VehicleState

FRAME = {"/mocap": ("", "frame_others_w_m")}
MOTION = {"/others": ("", "others_position_w_m others_velocity_w_mps others_unseen_s others_parked")}
_NOWHERE = (math.nan, math.nan, math.nan)


def gather(frame: MocapFrame | None, vehicle: VehicleState | None, parts: list[Any], arrays: list[Array]) -> None:
    """Append names and arrays of the other vehicles; nothing in a room of one vehicle."""
    if frame is not None and frame.others:
        parts.append(FRAME)
        arrays.append(_frame_array(frame.others))
    if vehicle is not None and vehicle.others:
        parts.append(MOTION)
        arrays += _motion_arrays(vehicle.others)


def _frame_array(others: Sequence[OtherBody]) -> Array:
    """Return the positions of a frame's other bodies, (n, 3); NaN where one is not seen."""
    return np.array([other.position_w_m or _NOWHERE for other in others])


def _motion_arrays(others: Sequence[OtherVehicle]) -> tuple[Array, ...]:
    """Return the other vehicles' positions and velocities (n, 3), time unseen and whether they are parked (n,)."""
    return (
        np.array([other.position_w_m for other in others]),
        np.array([other.velocity_w_mps for other in others]),
        np.array([other.unseen_s for other in others]),
        np.array([float(other.parked) for other in others]),
    )


def names_in(metadata: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the other vehicles' bodies by a record's own configuration, in the columns' order."""
    config = metadata.get("config", {})
    own = config.get("mocap", {}).get("body")
    return tuple(name for name in config.get("separation", {}).get("order", ()) if name != own)


def bodies_at(columns: Mapping[str, np.ndarray], row: int, names: Sequence[str]) -> tuple[OtherBody, ...]:
    """Return the other bodies of the frame in a row."""
    if "frame_others_w_m" not in columns:
        return ()
    places = columns["frame_others_w_m"][row].tolist()
    return tuple(
        OtherBody(name, (x, y, z) if math.isfinite(x) else None) for name, (x, y, z) in zip(names, places, strict=True)
    )


def vehicles_at(columns: Mapping[str, np.ndarray], row: int, names: Sequence[str]) -> tuple[OtherVehicle, ...]:
    """Return the other vehicles as the guard knew them in a row."""
    if "others_unseen_s" not in columns or np.isnan(columns["others_unseen_s"][row]).any():
        return ()
    rows = zip(
        names,
        columns["others_position_w_m"][row].tolist(),
        columns["others_velocity_w_mps"][row].tolist(),
        columns["others_unseen_s"][row].tolist(),
        columns["others_parked"][row].tolist(),
        strict=True,
    )
    return tuple(
        OtherVehicle(
            body=name,
            position_w_m=(x, y, z),
            velocity_w_mps=(vx, vy, vz),
            unseen_s=unseen_s,
            parked=bool(parked),
        )
        for name, (x, y, z), (vx, vy, vz), unseen_s, parked in rows
    )
