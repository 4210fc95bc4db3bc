"""Search space of another author's law: the ranges in [tune] of its file, and its gains as one batch of laws."""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from companion.config.controller_config import ControllerFiles, PeerFile, peer_law, read_peer
from companion.control.controller import VehicleModel
from companion.control.peers.outer_loop import PeerLaw
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.studies.tuning.gain_space import Knob

_AXIS_Z = ".z"
"""Ending of a knob for the third number of a gain; without such a knob all three are alike."""


@dataclass(frozen=True)
class PeerSpace:
    """Search space of a controller file with a [tune] table; ranges that begin above 0 are logarithmic."""

    files: ControllerFiles

    @cached_property
    def file(self) -> PeerFile:
        """The file's content; ConfigError for ranges that are none, or of no gain."""
        file = read_peer(self.files)
        for name, (low, high) in file.tune.items():
            gain = getattr(file.gains, name.removesuffix(_AXIS_Z), None)
            wrong = gain is None or isinstance(gain, bool) or (name.endswith(_AXIS_Z) and np.ndim(gain) != 1)
            if wrong:
                raise ConfigError(f"{self.files.path}: tune.{name}: there is no such gain with a number to search")
            if not 0.0 <= low < high:
                raise ConfigError(f"{self.files.path}: tune.{name} = [{low:g}, {high:g}]: must be 0 <= low < high")
        if not file.tune:
            raise ConfigError(f"{self.files.path}: has no [tune]: `companion tune` needs the ranges of its gains")
        return file

    @cached_property
    def knobs(self) -> tuple[Knob, ...]:
        """The numbers to search."""
        return tuple(Knob(name, low, high, linear=low == 0.0) for name, (low, high) in self.file.tune.items())

    @property
    def start(self) -> dict[str, float]:
        """The file's own gains."""
        return {knob.name: self._now(knob.name) for knob in self.knobs}

    def _now(self, name: str) -> float:
        gain = np.atleast_1d(getattr(self.file.gains, name.removesuffix(_AXIS_Z)))
        return float(gain[-1] if name.endswith(_AXIS_Z) else gain[0])

    def law_of(self, values: dict[str, Array], vehicle: VehicleModel, period_s: float) -> PeerLaw[Any]:
        """Return the laws of a batch of points as one law: gains (B, 1), those of axes (B, 3)."""
        fields: dict[str, object] = {}
        for name in (name for name in values if not name.endswith(_AXIS_Z)):
            column = values[name][:, None]
            if np.ndim(getattr(self.file.gains, name)):
                upward = values.get(name + _AXIS_Z, values[name])[:, None]
                column = np.concatenate((column, column, upward), axis=-1)
            fields[name] = column
        gains = {name: getattr(self.file.gains, name) for name in type(self.file.gains).model_fields}
        batch = self.file.model_copy(update={"gains": self.file.gains.model_construct(**(gains | fields))})
        return peer_law(batch, vehicle, period_s)

    def previews_s(self, law: PeerLaw[Any]) -> Array:
        """Return the previews of a batch of laws, (B,), or of all, (1,)."""
        return np.reshape(law.preview_s, -1)

    def penalty(self, points: Array) -> Array:
        """Return no penalty: no set is refused when it is loaded."""
        return np.zeros(len(points))

    def stable(self, values: dict[str, float]) -> bool:
        """Return True: flights alone decide."""
        return bool(values)

    def toml(self, values: dict[str, float], command: str) -> str:
        """Return the file's text with these gains, and the command that found them above [gains]."""
        text = re.sub(r"(?m)^# Gains found by `[^`]*`.*\n", "", self.files.text)
        head, _, rest = text.partition("[gains]\n")
        table, cut, tail = rest.partition("\n[")
        for name in (name for name in values if not name.endswith(_AXIS_Z)):
            number = f"{values[name]:.3g}"
            if np.ndim(getattr(self.file.gains, name)):
                number = f"[{number}, {number}, {values.get(name + _AXIS_Z, values[name]):.3g}]"
            table, count = re.subn(rf"(?m)^{name} = [^#\n]*?(\s*(?:#.*)?)$", rf"{name} = {number}\1", table)
            table = table if count else f"{name} = {number}\n{table}"
        return f"{head}# Gains found by `{command}`.\n[gains]\n{table}{cut}{tail}"
