"""The examples as their readers run them, one after another against one service and its mocks; docs/python.md."""

import asyncio
import json
import os
import re
import sys
import time
import types
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from tests import warm
from tests.flights import table_stub
from tests.flights.command import ROOT
from tests.flights.served import Seen, Site, looking_on, mocks, serving

pytestmark = pytest.mark.realtime


class Reader:
    """Somebody with the project's folder and a service that runs."""

    def __init__(self, site: Site, seen: Seen) -> None:
        self._seen = seen
        self._environment = {**os.environ, "COMPANION_BROKER": f"mqtt://127.0.0.1:{site.place.port}"}

    async def runs(self, module: str, *words: str) -> tuple[int, str, str]:
        """Run a program to its end; return exit code, output and errors. The vehicle has landed by then."""
        process = await warm.create_process(
            sys.executable,
            "-m",
            module,
            *words,
            cwd=ROOT,
            env=self._environment,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        began_s = time.monotonic()
        out, errors = (text.decode() for text in await process.communicate())
        print(f"{module} took {time.monotonic() - began_s:.1f} s\n{out}{errors}")
        assert process.returncode is not None
        state = await self._seen.newer()
        assert (state.armed, state.phase) == (False, "disarmed"), self._seen.story()
        return process.returncode, out, errors


async def test_the_examples_fly_and_a_script_that_raises_lands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = Site.embedded(tmp_path)
    line = tmp_path / "line.csv"
    line.write_text("t_s,x_m,y_m,z_m\n0,0,0,0.4\n0.6,0.1,0,0.4\n1.2,0.2,0,0.4\n2.4,0,0,0.4\n", encoding="utf-8")
    async with mocks(site), serving(site.config(arms=False), tmp_path / "log") as served:
        await served.says("the vehicle is there")
        async with looking_on(site.place, served) as seen:
            reader = Reader(site, seen)
            hello_flight(*await reader.runs("examples.hello_flight"))
            own_curve(*await reader.runs("examples.own_curve", "5"))
            raises(*await reader.runs("tests.flights.raises_in_the_air"))
            compare_laws(*await reader.runs("examples.compare_laws", str(site.records), str(line)))
        assert len(list(site.records.glob("*.mcap"))) == 4
        read_a_record(tmp_path, monkeypatch)


def hello_flight(code: int, out: str, errors: str) -> None:
    assert (code, errors) == (0, "")
    places = re.findall(r"^at \[ *(\S+) +(\S+) +(\S+) *\] m, battery \d\.\d+$", out, re.MULTILINE)
    for found, wanted in zip(np.array(places, dtype=float), ([0.3, 0.0, 0.5], [0.0, 0.0, 0.4]), strict=True):
        assert np.allclose(found, wanted, atol=0.15)


def own_curve(code: int, out: str, errors: str) -> None:
    assert (code, errors) == (0, "")
    mean_cm, most_cm = (float(value) for value in re.findall(r"error: mean (\S+) cm, largest (\S+) cm", out)[0])
    assert 0.0 < mean_cm < most_cm < 30.0


def raises(code: int, out: str, errors: str) -> None:
    assert code == 1
    assert "landing because of ValueError('hold at 0.4 m')" in errors
    traceback = errors[errors.index("Traceback") :]
    assert 'raise ValueError(f"{vehicle.state.phase} at' in traceback
    assert (
        "ValueError: hold at 0.4 m\nvehicle: landed because of ValueError('hold at 0.4 m'): down and dis" in traceback
    )


def compare_laws(code: int, out: str, errors: str) -> None:
    assert (code, errors) == (0, "")
    rows = re.findall(r"^waypoints with (\w+): (\S+) (\S+) (\S+) (\S+)$", out, re.MULTILINE)
    assert [name for name, *_ in rows] == ["etnn", "pid"]
    assert all(0.0 < float(value) < 50.0 for _, *values in rows for value in values)


def read_a_record(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the notebook's code on the newest record, with pandas where it is installed."""
    notebook = json.loads((ROOT / "examples" / "read_a_record.ipynb").read_text(encoding="utf-8"))
    assert all(not cell.get("outputs") for cell in notebook["cells"]), "it is kept without its results"
    (folder / "notebooks").mkdir()
    monkeypatch.chdir(folder / "notebooks")
    mpl.use("Agg")
    try:
        import pandas  # type: ignore[import-not-found,import-untyped,unused-ignore]  # noqa: F401
    except ModuleNotFoundError:
        stub: Any = types.ModuleType("pandas")
        stub.DataFrame = table_stub.DataFrame
        monkeypatch.setitem(sys.modules, "pandas", stub)
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "read_a_record.ipynb", "exec"), names)
    errors = names["mean_errors"]
    assert sorted(errors.index) == ["etnn", "pid"]
    assert all(0.0 < value < 50.0 for value in np.ravel(errors.to_numpy()))
    assert [len(axes.lines) for axes in names["figure"].axes] == [2, 6, 3, 3, 1]
