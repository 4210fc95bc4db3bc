"""Laws of users and of other authors that are traced: as in Python to the last bit, or in Python with the reason."""

import ctypes
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.compiled.c_source import traced
from companion.compiled.library import SOURCE, library
from companion.compiled.own_code import own_code
from companion.config.locations import project_root
from companion.geometry.array_math import where
from companion.simulation import traced_laws
from companion.simulation.compiled_flight import engine_of
from companion.simulation.mission import stacked
from companion.simulation.simulation import simulate, simulate_in_python
from companion.simulation.traced_laws import WORTH_COMPILING, code_of
from tests.control.first_law import PD, loaded
from tests.simulation.scenes import PUSHED, law_for, scene

pytestmark = pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")
EXAMPLES = project_root() / "examples" / "own_law"
FLOWN = ("position_w_m", "velocity_w_mps", "accel_w_mps2", "event", "sent")
LAW = PD.replace('{"integral": np.zeros_like(first.position_w_m)}', "np.zeros_like(first.position_w_m)")
LAW = LAW.replace('memory["integral"]', "memory").replace('return {"integral": integral}', "return integral")
"""The law of `first_law`, whose memory is an array."""


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patched:
        folder = tmp_path_factory.mktemp("cache")
        patched.setenv("XDG_CACHE_HOME", str(folder))
        yield folder / "dauam-companion"


@pytest.mark.parametrize("name", [str(EXAMPLES / "sliding_mode.toml"), "l1"])
def test_each_vehicle_of_a_batch_flies_as_it_would_alone_in_python(name: str, cache: Path) -> None:
    flown = scene(arms="swing", disturbance=PUSHED, settle_s=0.0)
    law, seeds = law_for(flown, name), list(range(WORTH_COMPILING))
    mission, before = flown.mission(law.law.preview_s), len(list(cache.glob("*.so")))
    together = simulate(flown.pilot(law), flown.vehicle(), stacked([mission] * len(seeds)), seeds)
    assert len(list(cache.glob("*.so"))) == before + 1
    assert not list(cache.glob("*.c")), "nothing but the library stays"
    alone = simulate_in_python(flown.pilot(law), flown.vehicle(), mission, [seeds[7]])
    for column in FLOWN:
        np.testing.assert_array_equal(getattr(together, column)[:, 7], getattr(alone, column))


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("integral = memory +", "integral = (error[..., 0] > 0) * 1.0 if error[..., 0] > 0 else memory +", "branch"),
        ("accel = -", "accel = np.sin(error) - ", "np.sin rounds as this processor does"),
        ("accel = -", "accel = error @ np.eye(3) - ", "np.matmul rounds"),
        ("return integral,", "return (integral, 3),", "its memory has another form"),
        ("return np.zeros_like(first.position_w_m)", "return 0", "its memory holds a int"),
    ],
    ids=["a branch", "a sine", "a product of matrices", "a memory that changes its form", "a counter"],
)
def test_what_cannot_be_traced_flies_in_python_and_says_why(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, old: str, new: str, why: str
) -> None:
    code = LAW.replace(old, new)
    assert code != LAW
    path = tmp_path / "pd.py"
    path.write_text(code, encoding="utf-8")
    law = _unchecked(path)
    with caplog.at_level(logging.INFO, logger=traced_laws.__name__):
        found = code_of(law)
    assert isinstance(found, str)
    assert why in found
    assert caplog.messages == [f"Pd flies in Python, slower than compiled: {found}"]
    if new not in ("return (integral, 3),", "return 0"):
        assert f"(line {code.splitlines().index(next(line for line in code.splitlines() if new in line)) + 1})" in found


def _unchecked(path: Path) -> Any:
    names: dict[str, Any] = {"__name__": "pd"}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    return names["Pd"](names["PdGains"](), None, 0.01)


def test_a_law_is_compiled_for_many_vehicles_alone_and_once(tmp_path: Path, cache: Path) -> None:
    law = loaded(tmp_path, LAW).law
    before = len(list(cache.glob("*.so")))
    assert "50 vehicles or more" in engine_of(law, WORTH_COMPILING - 1)
    assert len(list(cache.glob("*.so"))) == before
    for again in (law, law, loaded(tmp_path, LAW).law):
        assert engine_of(again, WORTH_COMPILING) == "compiled"
        assert len(list(cache.glob("*.so"))) == before + 1


def test_without_a_compiler_python_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert "it cannot be compiled here" in engine_of(loaded(tmp_path, LAW).law, WORTH_COMPILING)


FORMULAS: dict[str, Callable[[Any, Any], Any]] = {
    "clip": lambda a, b: np.clip(a, -0.5, np.abs(b)),
    "where": lambda a, b: np.where((a < b) & ~(b >= 0.3) | (a == 2.0), a, b / 3.0),
    "logic": lambda a, b: np.where(np.logical_and(a > 0.0, b > 0.0) | np.logical_not(a < -0.5), 1.0, a),
    "extremes": lambda a, b: np.maximum(a, b) - np.minimum(a, 0.1 * b),
    "sum": lambda a, b: np.sum(a * b, axis=-1, keepdims=True) + a.sum() + np.mean(b),
    "largest": lambda a, b: np.max(np.abs(a - b), axis=-1, keepdims=True) + b.min(),
    "event": lambda a, b: (np.abs(a).max(axis=-1, keepdims=True) >= 0.8).astype(float) * b,
    "any": lambda a, b: np.where(np.any(a > 1.0) | np.all(b < 0.0), a, b),
    "norm": lambda a, b: a / np.linalg.norm(b, axis=-1, keepdims=True),
    "crossed": lambda a, b: np.cross(a, b) / np.sqrt(np.sum(a * a)),
    "squares": lambda a, b: a**2 + np.square(b) - np.sqrt(a * a) + (b * b) ** 0.5,
    "sign": lambda a, b: np.sign(a) * np.copysign(a, b) + np.sign(0.0 * a),
    "like": lambda a, b: np.zeros_like(a) + np.ones_like(b) * a + np.full_like(a, 0.25),
    "joined": lambda a, b: np.concatenate((a[..., 1:], b[..., :1])) - np.stack((a, b), axis=-1)[..., 1],
    "matrix": lambda a, b: (np.broadcast_to(b, (3, 3)) * a[..., None]).sum(axis=-1),
    "chosen": lambda a, b: where(a[0] > b[0], a, b) + np.reciprocal(a) - (-a),
}
"""What numpy computes alike on every processor, in a law's words."""


def test_numpy_on_traced_arrays_is_numpy_on_numbers() -> None:
    """All formulas as one compiled function, against numpy, on random numbers with zeros and equal ones among them."""
    example = np.zeros(3)
    made = traced(
        "all", lambda a, b: {name: formula(a, b) + 0.0 * a for name, formula in FORMULAS.items()}, a=example, b=example
    )
    head = SOURCE.read_text(encoding="utf-8").split('#include "traced.c"')[0]
    head = head.replace('#include "flight.h"', SOURCE.with_suffix(".h").read_text(encoding="utf-8"))
    outputs = ", ".join(f"out + {3 * index}" for index in range(len(FORMULAS)))
    entry = f"void once(const double *a, const double *b, double *out) {{ all(a, b, {outputs}); }}"
    code = own_code("\n".join((head, made.layout, made.source, entry)))
    assert isinstance(code, ctypes.CDLL)
    rng, out = np.random.default_rng(5), (ctypes.c_double * (3 * len(FORMULAS)))()
    for _ in range(400):
        a, b = rng.normal(size=(2, 3))
        b = np.where(rng.random(3) < 0.1, a, b)
        code.once(*((ctypes.c_double * 3)(*vector) for vector in (a, b)), out)
        for index, (name, formula) in enumerate(FORMULAS.items()):
            expected = formula(a, b) + 0.0 * a
            np.testing.assert_array_equal(out[3 * index : 3 * index + 3], expected, err_msg=name)
