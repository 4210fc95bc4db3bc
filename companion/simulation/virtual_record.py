"""Virtual flights as columns of a record, so that summaries and figures work for both."""

from dataclasses import replace

import numpy as np

from companion.analysis.summary import Columns, tracking_error_w_m
from companion.core.types import Array
from companion.simulation.metrics import LOST_M
from companion.simulation.simulation import Trace
from companion.simulation.virtual_link_ends import Messages
from companion.supervisor.flight_state import Phase


def one_of(trace: Trace, number: int | slice) -> Trace:
    """Return the flight of one vehicle of a batch (B,), or of some."""
    apart = {"time_s", "signals", "messages"}
    batch = {name: values[:, number] for name, values in vars(trace).items() if name not in apart}
    signals = {name: values[:, number] for name, values in trace.signals.items()}
    messages = trace.messages
    if messages is not None:
        messages = Messages(**{name: values[:, number] for name, values in vars(messages).items()})
    return replace(trace, **batch, signals=signals, messages=messages)


def columns_of(trace: Trace, joints_rad: Array | None = None) -> Columns:
    """Return one vehicle's flight with the column names of a record; `joints_rad` (n, 8) are joint positions.

    Position and velocity are the truth, so they have no age; a cycle and its setpoint take no time.
    """
    time_s = trace.time_s
    no, yes = np.zeros(len(time_s)), np.ones(len(time_s), dtype=bool)
    columns: Columns = {
        "time_s": time_s,
        "tick": np.arange(len(time_s)),
        "airborne": yes,
        "phase": np.where(time_s >= 0.0, str(Phase.TRACK), str(Phase.HOLD)),
        "late_s": no,
        "age_s": no,
        "frame_received_s": time_s,
        "armed": yes,
        "touched_down": ~yes,
        "sent_s": np.where(trace.sent, time_s, np.nan),
        "event": trace.event,
        "position_w_m": trace.position_w_m,
        "velocity_w_mps": trace.velocity_w_mps,
        "reference_position_w_m": trace.reference_w_m,
        "reference_velocity_w_mps": trace.reference_velocity_w_mps,
        "accel_w_mps2": trace.accel_w_mps2,
    }
    if joints_rad is not None:
        columns["joint_position_rad"] = joints_rad
    return columns | {f"law_{name}": values for name, values in trace.signals.items()}


def until_lost(columns: Columns) -> Columns:
    """Return a flight up to a second after divergence, for figures: later values would hide all others."""
    time_s = np.asarray(columns["time_s"], dtype=np.float64)
    lost = np.flatnonzero(~(np.linalg.norm(tracking_error_w_m(columns), axis=1) <= LOST_M))
    shown = slice(None) if not lost.size else time_s <= time_s[lost[0]] + 1.0
    return {name: values[shown] for name, values in columns.items()}
