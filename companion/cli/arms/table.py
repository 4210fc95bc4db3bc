"""The arms' servos as tables and as JSON."""

import math
from typing import Any

from rich.table import Table
from rich.text import Text

from companion.adapters.dynamixel.checks import model_name
from companion.adapters.dynamixel.found import Found
from companion.arms.model import JOINT_NAMES
from companion.config.arms_config import ArmsConfig, ServoConfig
from companion.core.types import ArmStatus, Array

REFRESH_HZ = 5.0
"""Refresh rate of live tables."""
_RATE_OVER_S = 0.5


_STATE_COLUMNS = (
    "joint", "ID", "deg", "rad", "deg/s", "load\n%", "deg\nC", "V", "torque", "age\nms", "fault",
)  # fmt: skip
_MOVING_COLUMNS = (*_STATE_COLUMNS[:3], "off\ngoal", *_STATE_COLUMNS[4:])
_FOUND_COLUMNS = (
    "joint", "ID", "model", "firm-\nware", "proto-\ncol", "bits/s", "delay\nus", "V", "deg\nC", "deg",
)  # fmt: skip


def narrow_table(titles: tuple[str, ...], caption: str | None = None) -> Table:
    """Return a table that fits 80 columns; words are left-aligned, numbers right-aligned."""
    table = Table(box=None, pad_edge=False, padding=(0, 0, 0, 1), caption=caption, caption_justify="left")
    for title in titles:
        left = title in {"joint", "model", "torque", "fault"}
        table.add_column(title, justify="left" if left else "right", no_wrap=title != "fault")
    return table


class CycleMeter:
    """Meter of the bus's cycles per second, fed with statuses."""

    def __init__(self) -> None:
        self._cycles, self._time_s, self.rate_hz = 0, math.nan, math.nan

    def take(self, status: ArmStatus, now_s: float) -> float:
        """Return the rate (Hz) over the last half second or more; NaN before that."""
        if math.isnan(self._time_s):
            self._cycles, self._time_s = status.cycles, now_s
        elif now_s - self._time_s >= _RATE_OVER_S:
            self.rate_hz = (status.cycles - self._cycles) / (now_s - self._time_s)
            self._cycles, self._time_s = status.cycles, now_s
        return self.rate_hz


def state_table(arms: ArmsConfig, status: ArmStatus, now_s: float, rate_hz: float, goal_rad: Array | None) -> Table:
    """Return the servos' state as a table; with goals (8,) it has each joint's error instead of radians."""
    table = narrow_table(_STATE_COLUMNS if goal_rad is None else _MOVING_COLUMNS, bus_line(status, rate_hz))
    for place, name in enumerate(JOINT_NAMES):
        angle_rad = float(status.position_rad[place])
        off_rad = math.nan if goal_rad is None else angle_rad - float(goal_rad[place])
        cells = (
            name,
            str(arms.servos[name].id),
            _number(math.degrees(angle_rad), "+.1f"),
            _number(angle_rad, "+.3f") if goal_rad is None else _number(math.degrees(off_rad), "+.1f"),
            _number(math.degrees(status.velocity_radps[place]), "+.1f"),
            _number(100.0 * status.effort[place], "+.0f"),
            _number(status.temperature_c[place], ".0f"),
            _number(status.voltage_v[place], ".1f"),
            "on" if status.torque_on[place] else "off",
            _number(1e3 * (now_s - status.read_s[place]), ".0f"),
            Text(", ".join(fault.kind for fault in status.faults if fault.joint == name), style="bold red"),
        )
        table.add_row(*cells)
    return table


def torque_words(status: ArmStatus) -> str:
    """Return which joints have torque, in words."""
    limp = [name for name, on in zip(JOINT_NAMES, status.torque_on, strict=True) if not on]
    if len(limp) == len(JOINT_NAMES):
        return "torque is off"
    return f"without torque: {', '.join(limp)}" if limp else "torque is on"


def bus_line(status: ArmStatus, rate_hz: float) -> str:
    """Return the bus's cycle rate, cycle time and bad packets as one line."""
    rate = "" if math.isnan(rate_hz) else f"{rate_hz:.0f} cycles/s, "
    return f"bus: {rate}{1e3 * status.cycle_s:.1f} ms a cycle, {status.bad_packets} bad packets"


def found_table(arms: ArmsConfig, found: tuple[Found | None, ...], status: ArmStatus) -> Table:
    """Return the servos that answered and their settings as a table."""
    table = narrow_table(_FOUND_COLUMNS)
    for place, (name, one) in enumerate(zip(JOINT_NAMES, found, strict=True)):
        if one is not None:
            cells = (
                name,
                str(arms.servos[name].id),
                model_name(one.model_number),
                str(one.firmware),
                protocol_of(arms.servos[name]),
                f"{one.baud:.0f}",
                f"{one.return_delay_us:.0f}",
                f"{one.voltage_v:.1f}",
                f"{one.temperature_c:.0f}",
                _number(math.degrees(status.position_rad[place]), "+.1f"),
            )
            table.add_row(*cells)
    return table


def protocol_of(servo: ServoConfig) -> str:
    """Return the Dynamixel protocol version as the manuals write it."""
    return "1.0" if servo.model.startswith("AX") else "2.0"


def state_json(
    arms: ArmsConfig, status: ArmStatus, now_s: float, rate_hz: float, remarks: tuple[str, ...]
) -> dict[str, Any]:
    """Return the state as a JSON document: SI units in the names, null for values never read."""
    return {
        "port": arms.port,
        "cycles": status.cycles,
        "cycle_rate_hz": _finite(rate_hz),
        "cycle_s": _finite(status.cycle_s),
        "bad_packets": status.bad_packets,
        "joints": [_joint_json(arms, status, place, now_s) for place in range(len(JOINT_NAMES))],
        "faults": [{"joint": f.joint, "kind": f.kind.value, "text": f.text} for f in status.faults],
        "remarks": list(remarks),
    }


def _joint_json(arms: ArmsConfig, status: ArmStatus, place: int, now_s: float) -> dict[str, Any]:
    name = JOINT_NAMES[place]
    return {
        "joint": name,
        "id": arms.servos[name].id,
        "model": arms.servos[name].model,
        "position_rad": _finite(status.position_rad[place]),
        "velocity_radps": _finite(status.velocity_radps[place]),
        "load_share": _finite(status.effort[place]),
        "temperature_c": _finite(status.temperature_c[place]),
        "voltage_v": _finite(status.voltage_v[place]),
        "torque_on": bool(status.torque_on[place]),
        "age_s": _finite(now_s - status.read_s[place]),
    }


def _finite(value: float) -> float | None:
    return round(float(value), 6) if math.isfinite(value) else None


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "?"
