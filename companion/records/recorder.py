"""Keeps every tick of a flight in memory and writes it as one NPZ file."""

from pathlib import Path

import numpy as np

from companion.arms.model import JOINT_COUNT
from companion.core.types import Array
from companion.flight.tick import Tick
from companion.records.split.link_columns import ACCEL, NUMBERS, link_accel, link_numbers

_NOWHERE = np.full(3, np.nan)
_NO_ATTITUDE = np.full(4, np.nan)
_NO_JOINTS = np.full(JOINT_COUNT, np.nan)


class _Rows:
    """Column of vectors of one shape, one row per tick, that doubles when full; NaN where nothing was put."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._values = np.full((1024, *shape), np.nan)

    def put(self, row: int, value: Array) -> None:
        while row >= len(self._values):
            self._values = np.concatenate((self._values, np.full_like(self._values, np.nan)))
        self._values[row] = value

    def array(self, count: int) -> Array:
        """Return the first `count` rows, (count, *shape)."""
        if count > len(self._values):
            self.put(count - 1, np.full(self._values.shape[1:], np.nan))
        return self._values[:count].copy()


class Recorder:
    """A TickSink. Appending costs microseconds; ten minutes take about 50 MB."""

    def __init__(self) -> None:
        self._columns: dict[str, list[object]] = {}
        self._vectors: dict[str, _Rows] = {}
        self._count = 0

    @property
    def flew(self) -> bool:
        """True when the law flew in at least one tick."""
        return any(self._columns.get("airborne", ()))

    def __call__(self, tick: Tick) -> None:
        """Append the columns of one tick."""
        vehicle, reference, output, limited = tick.vehicle, tick.reference, tick.pipeline, tick.limited
        scalars: dict[str, object] = {
            "time_s": tick.time_s,
            "phase": str(tick.flight.phase),
            "late_s": tick.late_s,
            "age_s": tick.age_s,
            "frame_received_s": tick.frame_received_s,
            "sent_s": tick.sent_s,
            "airborne": tick.flight.airborne,
            "touched_down": tick.flight.touched_down,
            "reason": tick.flight.reason,
            "faults": ", ".join(event.fault for event in tick.events),
            "armed": tick.status.armed,
            "mode": str(tick.status.mode),
            "event": bool(output and output.law_output.event.any()),
            "setpoint_thrust": float(limited.setpoint.thrust) if limited else np.nan,
            "limits_cut": bool(limited.not_finite | limited.tilt_cut | limited.thrust_cut | limited.slew_cut)
            if limited
            else False,
            "guard_cut": bool(limited and (limited.age_cut | limited.fence_cut)),
        }
        vectors: dict[str, Array] = {
            "position_w_m": vehicle.position_w_m if vehicle else _NOWHERE,
            "velocity_w_mps": vehicle.velocity_w_mps if vehicle else _NOWHERE,
            "q_w_flu_wxyz": vehicle.q_w_flu_wxyz if vehicle else _NO_ATTITUDE,
            "reference_position_w_m": reference.position_w_m if reference else _NOWHERE,
            "reference_velocity_w_mps": reference.velocity_w_mps if reference else _NOWHERE,
            "accel_w_mps2": output.law_output.accel_w_mps2 if output else _NOWHERE,
            "setpoint_q_w_flu_wxyz": limited.setpoint.q_w_flu_wxyz if limited else _NO_ATTITUDE,
        }
        if tick.arms is not None:
            goal, status = tick.arms.goal, tick.arms.status
            scalars |= {
                "arm_phase": str(tick.arms.phase),
                "arm_bus_cycle_s": status.cycle_s,
                "arm_bad_packets": status.bad_packets,
            }
            vectors |= {
                "joint_goal_rad": goal.position_rad if goal else _NO_JOINTS,
                "joint_position_rad": status.position_rad,
                "joint_velocity_radps": status.velocity_radps,
                "joint_effort": status.effort,
                "joint_temperature_c": status.temperature_c,
                "arms_known_accel_w_mps2": tick.arms.known_accel_w_mps2,
            }
        if tick.link is not None:
            scalars |= dict(zip(NUMBERS, link_numbers(tick.link), strict=True))
            vectors[ACCEL] = link_accel(tick.link)
        signals = (output.law_output.signals if output else {}) | tick.late_signals
        for name, value in scalars.items():
            self._columns.setdefault(name, []).append(value)
        for name, vector in (vectors | {f"law_{name}": signal for name, signal in signals.items()}).items():
            if name not in self._vectors:
                self._vectors[name] = _Rows(np.shape(vector))
            self._vectors[name].put(self._count, vector)
        self._count += 1

    def arrays(self) -> dict[str, np.ndarray]:
        """Return every column, one row per tick; a law's internal signals as `law_<name>`, NaN while it was idle."""
        columns = {name: np.array(values) for name, values in self._columns.items()}
        return columns | {name: rows.array(self._count) for name, rows in self._vectors.items()}

    def write(self, path: Path) -> None:
        """Write all columns as a compressed NPZ file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **self.arrays())  # type: ignore[arg-type]
