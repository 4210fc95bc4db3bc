"""Keeps every tick of a flight in memory and writes it as one NPZ file."""

from pathlib import Path

import numpy as np

from companion.flight_loop import Tick
from companion.types import Array

_NOWHERE = np.full(3, np.nan)
_NO_ATTITUDE = np.full(4, np.nan)


class Recorder:
    """A TickSink. Appending costs microseconds; arrays are made when somebody asks."""

    def __init__(self) -> None:
        self._columns: dict[str, list[object]] = {}
        self._signals: dict[str, list[tuple[int, Array]]] = {}
        self._count = 0

    @property
    def flew(self) -> bool:
        """Whether the law was ever in charge."""
        return any(self._columns.get("airborne", ()))

    def __call__(self, tick: Tick) -> None:
        """Append one tick."""
        vehicle, reference, asked, gated = tick.vehicle, tick.reference, tick.asked, tick.gated
        row: dict[str, object] = {
            "time_s": tick.time_s,
            "phase": str(tick.flight.phase),
            "late_s": tick.late_s,
            "age_s": tick.age_s,
            "frame_received_s": tick.frame_received_s,
            "sent_s": tick.sent_s,
            "airborne": tick.flight.airborne,
            "touched_down": tick.flight.touched_down,
            "armed": tick.status.armed,
            "mode": str(tick.status.mode),
            "position_w_m": vehicle.position_w_m if vehicle else _NOWHERE,
            "velocity_w_mps": vehicle.velocity_w_mps if vehicle else _NOWHERE,
            "q_w_flu_wxyz": vehicle.q_w_flu_wxyz if vehicle else _NO_ATTITUDE,
            "reference_position_w_m": reference.position_w_m if reference else _NOWHERE,
            "reference_velocity_w_mps": reference.velocity_w_mps if reference else _NOWHERE,
            "event": bool(asked.output.event.any()) if asked else False,
            "accel_w_mps2": asked.output.accel_w_mps2 if asked else _NOWHERE,
            "setpoint_q_w_flu_wxyz": gated.setpoint.q_w_flu_wxyz if gated else _NO_ATTITUDE,
            "setpoint_thrust": float(gated.setpoint.thrust) if gated else np.nan,
            "gate_cut": bool(gated.not_finite | gated.tilt_cut | gated.thrust_cut | gated.slew_cut) if gated else False,
        }
        for name, value in row.items():
            self._columns.setdefault(name, []).append(value)
        for name, signal in ((asked.output.signals if asked else {}) | tick.late_signals).items():
            self._signals.setdefault(name, []).append((self._count, signal))
        self._count += 1

    def arrays(self) -> dict[str, np.ndarray]:
        """Every column, one row a tick; a law's inner signals as `law_<name>`, NaN where the law slept."""
        columns = {name: np.array(values) for name, values in self._columns.items()}
        for name, values in self._signals.items():
            column = np.full((self._count, *np.shape(values[0][1])), np.nan)
            for row, signal in values:
                column[row] = signal
            columns[f"law_{name}"] = column
        return columns

    def write(self, path: Path) -> None:
        """Write all columns as a compressed NPZ file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **self.arrays())  # type: ignore[arg-type]
