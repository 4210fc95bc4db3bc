"""PX4's parameters: names, types and values as recorded, and the few that change the mock's behaviour."""

import csv
import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

TABLE = Path(__file__).parents[1] / "data" / "params.csv"
INT32 = 6
REAL32 = 9
"""MAV_PARAM_TYPE of the only two types PX4 has."""


class UnknownParamError(ValueError):
    """A parameter that this PX4 does not have, or a value its type cannot hold."""


@dataclass(frozen=True)
class Param:
    """One parameter as it stands in PX4's list."""

    name: str
    index: int
    type: int
    value: float

    @property
    def wire_bytes(self) -> bytes:
        """Return the four bytes of PARAM_VALUE.param_value: integers are laid into the float byte by byte."""
        return struct.pack("<i", int(self.value)) if self.type == INT32 else struct.pack("<f", self.value)


class ParamTable:
    """All parameters of one vehicle; reading is by name, changes are kept in memory only."""

    def __init__(self, changed: Mapping[str, float] | None = None) -> None:
        self._by_name = {param.name: param for param in _recorded()}
        self._by_index = list(self._by_name)
        for name, value in (changed or {}).items():
            self.change(name, value)

    def __len__(self) -> int:
        return len(self._by_index)

    def __iter__(self) -> Iterator[Param]:
        return iter(list(self._by_name.values()))

    def __getitem__(self, name: str) -> float:
        return self._by_name[name].value

    def find(self, name: str) -> Param | None:
        """Return the parameter of that name, or None."""
        return self._by_name.get(name)

    def at(self, index: int) -> Param | None:
        """Return the parameter at that index of the list, or None."""
        return self._by_name[self._by_index[index]] if 0 <= index < len(self._by_index) else None

    @property
    def trim_times_s(self) -> tuple[float, float, float]:
        """Return the rate loops' time constants for a constant torque about body x, y, z: P / I, infinite without I."""
        roll_s, pitch_s, yaw_s = (
            self[f"MC_{axis}RATE_P"] / self[f"MC_{axis}RATE_I"] if self[f"MC_{axis}RATE_I"] else math.inf
            for axis in ("ROLL", "PITCH", "YAW")
        )
        return roll_s, pitch_s, yaw_s

    def change(self, name: str, value: float) -> Param:
        """Set a parameter, without a check of its range, as in PX4; raise UnknownParamError for a wrong name."""
        param = self._by_name.get(name)
        if param is None:
            raise UnknownParamError(f"PX4 has no parameter {name}")
        if param.type == INT32 and (value != int(value) or not -(2**31) <= value < 2**31):
            raise UnknownParamError(f"parameter {name} is a whole number of 32 bits, {value} is not")
        self._by_name[name] = Param(name, param.index, param.type, _as_stored(param.type, value))
        return self._by_name[name]

    def change_from_wire(self, name: str, wire_bytes: bytes, type_: int) -> Param | None:
        """Set a parameter from PARAM_SET; for an unknown name or a wrong type change nothing and return None."""
        param = self._by_name.get(name)
        if param is None or param.type != type_:
            return None
        (value,) = struct.unpack("<i" if type_ == INT32 else "<f", wire_bytes)
        self._by_name[name] = Param(name, param.index, param.type, value)
        return self._by_name[name]


def _as_stored(type_: int, value: float) -> float:
    return int(value) if type_ == INT32 else float(struct.unpack("<f", struct.pack("<f", value))[0])


def _recorded() -> Iterator[Param]:
    with TABLE.open(newline="", encoding="ascii") as file:
        rows = csv.reader(line for line in file if not line.startswith("#"))
        next(rows)
        for index, (name, kind, value) in enumerate(rows):
            type_ = INT32 if kind == "INT32" else REAL32
            yield Param(name, index, type_, _as_stored(type_, float(value)))
