"""The batteries that PX4 measures, by their number, and the one that carries the vehicle."""

import math
from collections.abc import Sequence
from typing import Any

from companion.core.types import BatteryReading

_NOT_MEASURED = 65535
"""UINT16_MAX, mV."""


def reading(fields: dict[str, Any]) -> BatteryReading:
    """Return one BATTERY_STATUS as SI values; NaN for what PX4 does not know: a charge of -1 %, no cell's voltage."""
    cells = [mv for mv in fields["voltages"] if mv != _NOT_MEASURED]
    cells += [mv for mv in fields.get("voltages_ext") or () if mv]  # 0: no such cell
    percent = fields["battery_remaining"]
    return BatteryReading(
        id=fields["id"],
        fraction=percent / 100.0 if percent >= 0 else math.nan,
        voltage_v=1e-3 * sum(cells) if cells else math.nan,
    )


def merged(known: Sequence[BatteryReading], new: BatteryReading) -> tuple[BatteryReading, ...]:
    """Return the readings with the new one in the place of its battery's last; by number."""
    others = [one for one in known if one.id != new.id]
    return tuple(sorted((*others, new), key=lambda one: one.id))


def flight_battery(known: Sequence[BatteryReading], configured: int | None) -> BatteryReading:
    """Return the reading of the configured battery, else of the lowest number heard; all unknown if there is none."""
    for one in known:
        if configured is None or one.id == configured:
            return one
    return BatteryReading(id=-1 if configured is None else configured, fraction=math.nan, voltage_v=math.nan)
