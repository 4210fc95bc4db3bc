"""Build of the project on a computer: source, Python, numpy, compiled code, and how their arithmetic rounds.

Equal builds give equal results, to the last bit.
"""

import hashlib
import math
import platform
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import companion
import mock_autopilot
from companion.compiled.library import library

_SOURCE = frozenset({".py", ".csv", ".npz", ".json", ".toml", ".c", ".h"})
"""Suffixes of files that results depend on."""
_FUNCTIONS = (np.exp, np.log1p, np.sin, np.cos, np.tan, np.tanh, np.arcsin, np.arctan, np.sqrt, np.reciprocal)
"""Functions that numpy computes in another way on another processor, for numbers between 0 and 1."""
_SAME = (math.exp, math.log1p, math.sin, math.cos, math.tan, math.tanh, math.asin, math.atan)
"""Those of the computer's C library."""
_COUNT = 4096


@dataclass(frozen=True)
class Build:
    """Everything beside a job that its result depends on."""

    version: str
    source: str
    """Digest of the source and the data of both packages."""
    python: str
    """Major and minor version."""
    numpy: str
    engine: str
    """Code that flies: compiled from the same source, or Python, whose numpy rounds batches in another way."""
    arithmetic: str
    """Digest of what functions, products and random numbers are here."""

    def difference(self, other: "Build") -> str:
        """Return in words what another build has that this one has not; empty when they are equal."""
        for name, words in _WORDS.items():
            mine, its = getattr(self, name), getattr(other, name)
            if mine != its:
                return words.format(mine=mine, its=its)
        return ""


_WORDS = {
    "version": "has companion {its}, not {mine}",
    "source": "has companion of other source ({its}, not {mine})",
    "python": "has Python {its}, not {mine}",
    "numpy": "has numpy {its}, not {mine}",
    "engine": "flies with {its}, not with {mine}",
    "arithmetic": "rounds in another way: its processor or C library is of another kind",
}


@cache
def this_build() -> Build:
    """Return the build that this process runs."""
    return Build(
        version=companion.__version__,
        source=_source(),
        python=".".join(platform.python_version_tuple()[:2]),
        numpy=np.__version__,
        engine=_engine(),
        arithmetic=_arithmetic(),
    )


def _engine() -> str:
    if library() is None:
        return "Python alone"
    return "the compiled law" if shutil.which("cc") else "the compiled law, but no compiler for others"


def _source() -> str:
    whole = hashlib.sha256()
    for package in (companion, mock_autopilot):
        assert package.__file__ is not None
        folder = Path(package.__file__).parent
        for file in sorted(folder.rglob("*")):
            if file.suffix in _SOURCE and file.is_file():
                data = file.read_bytes()
                whole.update(f"{file.relative_to(folder)} {len(data)} ".encode() + data)
    return whole.hexdigest()[:12]


def _arithmetic() -> str:
    random = np.random.default_rng(1)
    share, normal = random.random(_COUNT), random.standard_normal(_COUNT)
    table = normal.reshape(64, 64)
    arrays = [share, normal, share**normal, np.arctan2(share, normal), table @ table, table.sum(axis=0)]
    arrays += [function(share) for function in _FUNCTIONS]
    arrays += [np.array([function(one) for one in share.tolist()]) for function in _SAME]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()[:12]
