"""Flight read from a file: columns, events, and the exact inputs of each cycle."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from companion.control.controller import ControlInput
from companion.control.horizon_correction import HorizonInput
from companion.control.remote_law import RemoteCommand
from companion.core.types import Array, AttitudeThrust, GroundPose, MocapFrame, OtherVehicle, Reference
from companion.estimation.state import EstimatorState
from companion.records import others
from companion.records.errors import RecordError
from companion.records.exact_json import of_json
from companion.records.table import GROUND, HealthEvent, RecordedEvent

_OURS = frozenset({"law_name"})
_FOR_REPLAY = ("tick", "law_name", "sent_s")
"""Columns that every record of the service has."""
_OF_FRAMES = (
    "frame_number", "frame_stamp_s", "frame_received_s", "frame_position_w_m", "frame_rotation_w_b",
    "frame_residual_m", "frame_late",
)  # fmt: skip
"""Columns besides, once motion capture gave a frame."""
_WITHOUT_FRAMES = (
    "ground_pose_s", "ground_pose_yaw_rad", "ground_pose_position_w_m", "autopilot_q_w_flu_wxyz",
    "autopilot_rate_flu_radps", "autopilot_velocity_w_mps", "attitude_s", "velocity_s",
)  # fmt: skip
"""Columns instead, on a vehicle that frames do not reach, once the ground gave a pose."""
_OF_A_LAW = (
    "event", "begun", "accel_w_mps2", "given_position_w_m", "given_velocity_w_mps", "given_q_w_flu_wxyz",
    "given_rate_flu_radps", "given_age_s", "given_reference_position_w_m", "given_reference_velocity_w_mps",
    "given_reference_acceleration_w_mps2", "given_reference_yaw_rad", "given_sent_accel_w_mps2", "given_dt_s",
    "given_known_accel_w_mps2",
)  # fmt: skip
"""Columns besides, once a law was in charge."""

_HORIZON = ("horizon_off_roll_rad", "horizon_off_pitch_rad", "horizon_roll_rad", "horizon_pitch_rad")


@dataclass(frozen=True, kw_only=True)
class RecordedWire:
    """Setpoint that was sent in place of the law's, and the corrections that it includes."""

    setpoint: AttitudeThrust
    last_q_w_flu_wxyz: Array
    is_new: bool
    inputs: HorizonInput
    error_rad: Array
    """Roll and pitch of the slow difference, then those of the correction, (4,)."""
    dt_s: float
    begun: bool


@dataclass(frozen=True, kw_only=True)
class RecordedMotion:
    """The autopilot's own motion, and the ground's pose that this cycle was the first to use."""

    q_w_flu_wxyz: Array
    rate_flu_radps: Array
    attitude_s: float
    velocity_w_mps: Array
    velocity_s: float
    pose: GroundPose | None


@dataclass(frozen=True, kw_only=True)
class RecordedTick:
    """Exact inputs and outputs of one cycle; arrays with the law's types and shapes."""

    number: int
    """Counted by the service: one is missing where rows were dropped."""
    time_s: float
    phase: str
    law: str
    frame: MocapFrame | None
    """The motion-capture frame that this cycle was the first to use."""
    motion: RecordedMotion | None
    """Inputs of the estimate on a vehicle that frames do not reach; None where they do."""
    given: ControlInput | None
    """All that the law saw; None while it sleeps."""
    others: tuple[OtherVehicle, ...]
    """The other vehicles, as the guard knew them."""
    begun: bool
    """The law was restarted with this input."""
    accel_w_mps2: Array | None
    """Acceleration that the law commanded."""
    event: bool
    signals: dict[str, Array]
    setpoint: AttitudeThrust | None
    sent_s: float
    airborne: bool = False
    epoch: int = 0
    """Number of the flight, counted by the vehicle, where the law is on the ground; else 0."""
    made_for_s: float = math.nan
    """Age of the uplink that a law on the ground was made for; NaN on the vehicle."""
    mirror: AttitudeThrust | None = None
    """Setpoint that the ground took the vehicle to have sent last; None on the vehicle."""
    command: RemoteCommand | None = None
    """Command in use of a law on the ground; None for a law on board."""
    wire: RecordedWire | None = None
    """Also in cycles in which it was as before and did not leave again; None in an old record."""


@dataclass(frozen=True, kw_only=True)
class FlightRecord:
    """Recorded flight: columns, events and metadata."""

    path: Path
    columns: dict[str, np.ndarray]
    """One row a tick; NaN, "" or False where there was nothing. Recorder.arrays()' names and more: docs/records.md."""
    events: tuple[RecordedEvent, ...] = ()
    """Commands, replies and messages of the service."""
    health: tuple[HealthEvent, ...] = ()
    metadata: dict[str, Any] = field(default_factory=dict)
    """`config`, `controller`, `versions`, `seed` and whatever else the service recorded; empty in an old NPZ file."""
    start: dict[str, Any] = field(default_factory=dict)
    """`time_s`, `number` and `estimate` (JSON) of the first tick."""
    truncated: bool = False
    """The file ends in the middle: service and writer were killed."""
    damage: str = ""
    """In words, the first part that could not be read; empty where the file is whole, or only cut off."""

    ground: "FlightRecord | None" = None
    """Ground's side, in a merged file: its own rows, times on the vehicle's clock."""

    @property
    def is_of_ground(self) -> bool:
        """Return True for the record of `companion law`, False for that of a vehicle."""
        return self.metadata.get("side") == GROUND

    @property
    def unix_offset_s(self) -> float:
        """Unix time minus `time_s`; 0 where it was not recorded."""
        return float(self.metadata.get("unix_offset_s", 0.0))

    @property
    def dropped(self) -> int:
        """Number of ticks of the service that are missing from the record."""
        numbers = self.columns.get("tick", np.zeros(0))
        return int(numbers[-1] - numbers[0]) + 1 - len(numbers) if len(numbers) else 0

    @cached_property
    def first_estimate(self) -> EstimatorState | None:
        """Estimator state after the first tick's frame; a replay begins with it. None where it was not recorded."""
        known = self.start.get("estimate")
        try:
            return of_json(EstimatorState, json.dumps(known)) if known else None
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(f"{self.path}: the estimate at its begin is another version's or damaged") from error

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """Return the names of the laws that flew, in order."""
        if "law_name" not in self.columns or "airborne" not in self.columns:
            return ()
        return tuple(
            dict.fromkeys(str(name) for name in self.columns["law_name"][self.columns["airborne"] > 0] if name)
        )

    @cached_property
    def other_names(self) -> tuple[str, ...]:
        """Bodies of the other vehicles, in the order of their columns; empty in a room of one vehicle."""
        return others.names_in(self.metadata)

    @property
    def frames(self) -> bool:
        """Return True unless it is the record of a vehicle that frames do not reach."""
        law = self.metadata.get("config", {}).get("law", {})
        return self.is_of_ground or bool(law.get("onboard_mocap", True))

    @property
    def law_flew(self) -> bool:
        """Return True when a law flew in at least one cycle."""
        given = self.columns.get("given_dt_s")
        return given is not None and bool(np.isfinite(given).any())

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of the laws' internal signals, without the prefix `law_`."""
        return tuple(
            name.removeprefix("law_") for name in self.columns if name.startswith("law_") and name not in _OURS
        )

    def ticks(self) -> Iterator[RecordedTick]:
        """Return every recorded cycle; RecordError when the record does not have all that a replay needs."""
        needed = _FOR_REPLAY + (_OF_FRAMES if self.frames else _WITHOUT_FRAMES) + (_OF_A_LAW if self.law_flew else ())
        missing = [name for name in needed if name not in self.columns]
        if missing:
            raise RecordError(f"{self.path}: no column {missing[0]}: too old or too short a record for a replay")
        names = self.signal_names
        for row in range(len(self.columns["time_s"])):
            yield self._tick(row, names)

    def _tick(self, row: int, names: tuple[str, ...]) -> RecordedTick:
        c = self.columns
        flown = "given_dt_s" in c and np.isfinite(c["given_dt_s"][row])
        sent = "setpoint_thrust" in c and np.isfinite(c["setpoint_thrust"][row])
        return RecordedTick(
            number=int(c["tick"][row]),
            time_s=float(c["time_s"][row]),
            phase=str(c["phase"][row]),
            law=str(c["law_name"][row]),
            frame=self._frame(row) if self.frames and np.isfinite(c["frame_stamp_s"][row]) else None,
            motion=None if self.frames else self._motion(row),
            given=self._given(row) if flown else None,
            others=others.vehicles_at(c, row, self.other_names) if flown else (),
            begun=bool(flown and c["begun"][row]),
            accel_w_mps2=c["accel_w_mps2"][row] if flown else None,
            event=bool(flown and c["event"][row]),
            signals={name: c[f"law_{name}"][row] for name in names if not np.isnan(c[f"law_{name}"][row]).all()},
            setpoint=AttitudeThrust(c["setpoint_q_w_flu_wxyz"][row], np.asarray(c["setpoint_thrust"][row]))
            if sent
            else None,
            sent_s=float(c["sent_s"][row]),
            airborne=bool(c["airborne"][row]) if "airborne" in c else flown,
            epoch=int(c["link_epoch"][row]) if "link_epoch" in c else 0,
            made_for_s=float(c["link_made_for_s"][row]) if "link_made_for_s" in c else math.nan,
            mirror=self._mirror(row) if "mirror_thrust" in c and flown else None,
            command=self._command(row) if "link_command" in c else None,
            wire=self._wire(row) if "wire_thrust" in c and np.isfinite(c["wire_thrust"][row]) else None,
        )

    def _wire(self, row: int) -> RecordedWire:
        c = self.columns
        inputs = HorizonInput(
            q_w_flu_wxyz=c["q_w_flu_wxyz"][row],
            rate_flu_radps=c["rate_flu_radps"][row],
            age_s=float(c["age_s"][row]),
            autopilot_q_w_flu_wxyz=c["horizon_autopilot_q_w_flu_wxyz"][row],
            autopilot_age_s=float(c["horizon_autopilot_age_s"][row]),
            trusted=bool(c["horizon_trusted"][row]),
            flying=bool(c["horizon_flying"][row]),
        )
        return RecordedWire(
            setpoint=AttitudeThrust(c["wire_q_w_flu_wxyz"][row], np.asarray(c["wire_thrust"][row])),
            last_q_w_flu_wxyz=c["wire_last_q_w_flu_wxyz"][row],
            is_new=bool(c["wire_is_new"][row]),
            inputs=inputs,
            error_rad=np.array([float(c[name][row]) for name in _HORIZON]),
            dt_s=float(c["horizon_dt_s"][row]),
            begun=bool(c["horizon_begun"][row]),
        )

    def _motion(self, row: int) -> RecordedMotion:
        c, pose = self.columns, None
        if np.isfinite(c["ground_pose_s"][row]):
            pose = GroundPose(
                time_s=float(c["ground_pose_s"][row]),
                position_w_m=c["ground_pose_position_w_m"][row],
                yaw_rad=float(c["ground_pose_yaw_rad"][row]),
            )
        return RecordedMotion(
            q_w_flu_wxyz=c["autopilot_q_w_flu_wxyz"][row],
            rate_flu_radps=c["autopilot_rate_flu_radps"][row],
            attitude_s=float(c["attitude_s"][row]),
            velocity_w_mps=c["autopilot_velocity_w_mps"][row],
            velocity_s=float(c["velocity_s"][row]),
            pose=pose,
        )

    def _command(self, row: int) -> RemoteCommand:
        c = self.columns
        yaw_rad = float(c["link_yaw_rad"][row])
        return RemoteCommand(
            number=int(c["link_command"][row]),
            accel_w_mps2=c["link_accel_w_mps2"][row],
            yaw_rad=None if np.isnan(yaw_rad) else yaw_rad,
            age_s=float(c["link_command_age_s"][row]),
        )

    def _mirror(self, row: int) -> AttitudeThrust:
        c = self.columns
        return AttitudeThrust(c["mirror_q_w_flu_wxyz"][row], np.asarray(c["mirror_thrust"][row]))

    def _frame(self, row: int) -> MocapFrame:
        c = self.columns
        return MocapFrame(
            frame=int(c["frame_number"][row]),
            stamp_s=float(c["frame_stamp_s"][row]),
            received_s=float(c["frame_received_s"][row]),
            position_w_m=c["frame_position_w_m"][row],
            rotation_w_b=c["frame_rotation_w_b"][row],
            residual_m=float(c["frame_residual_m"][row]),
            late=int(c["frame_late"][row]),
            others=others.bodies_at(c, row, self.other_names),
        )

    def _given(self, row: int) -> ControlInput:
        c = {name.removeprefix("given_"): column for name, column in self.columns.items() if name.startswith("given_")}
        return ControlInput(
            position_w_m=c["position_w_m"][row],
            velocity_w_mps=c["velocity_w_mps"][row],
            q_w_flu_wxyz=c["q_w_flu_wxyz"][row],
            rate_flu_radps=c["rate_flu_radps"][row],
            age_s=float(c["age_s"][row]),
            reference=Reference(
                c["reference_position_w_m"][row],
                c["reference_velocity_w_mps"][row],
                c["reference_acceleration_w_mps2"][row],
                float(c["reference_yaw_rad"][row]),
            ),
            sent_accel_w_mps2=c["sent_accel_w_mps2"][row],
            dt_s=float(c["dt_s"][row]),
            known_accel_w_mps2=c["known_accel_w_mps2"][row],
        )
