"""The examples as their readers run them, against two services and their mocks in one room; docs/python.md."""

import asyncio
import json
import os
import re
import sys
import time
import types
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from companion.cli.demo.fleet.room import RoomPlan, plan_room
from companion.cli.demo.mock_process import mock_process
from companion.config.companion_config import load_config
from companion.config.operator_config import OperatorConfig
from tests import warm
from tests.broker import BrokerProcess
from tests.flights import table_stub
from tests.flights.command import ROOT, mock_config
from tests.flights.served import Seen, Site, looking_on, serving

pytestmark = pytest.mark.realtime


class Reader:
    """Somebody with the project's folder and a service that runs."""

    def __init__(self, place: OperatorConfig, seen: Seen) -> None:
        self._seen = seen
        named = {"COMPANION_BROKER": f"mqtt://127.0.0.1:{place.port}", "COMPANION_VEHICLE": place.vehicle}
        self._environment = os.environ | named

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

    async def runs_all(self, *programs: tuple[str, ...]) -> list[tuple[int, str, str]]:
        """Run programs one after another."""
        return [await self.runs(*words) for words in programs]


async def test_the_examples_fly_and_a_script_that_raises_lands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = Site.embedded(tmp_path)
    plan = own_folders(plan_room(load_config(site.config(arms=False)), 2, site.records, free=True))
    line = tmp_path / "line.csv"
    line.write_text("t_s,x_m,y_m,z_m\n0,0,3.4,0.4\n0.6,0.1,3.4,0.4\n1.2,0.2,3.4,0.4\n2.4,0,3.4,0.4\n", encoding="utf-8")
    laws = ("examples.compare_laws", str(site.records / "dauam-2"), str(line))
    async with room(plan, tmp_path) as (one, other):
        two_vehicles(*await one.runs("examples.two_vehicles", "dauam-1", "dauam-2"))
        hello, curve = ("examples.hello_flight",), ("examples.own_curve", "5")
        flown = await asyncio.gather(
            one.runs_all(hello, curve), other.runs_all(("tests.flights.raises_in_the_air",), laws)
        )
        hello_flight(*flown[0][0])
        own_curve(*flown[0][1])
        raises(*flown[1][0])
        compare_laws(*flown[1][1])
    assert [len(list(site.records.glob(f"dauam-{number}/*.mcap"))) for number in (1, 2)] == [3, 3]
    read_a_record(site.records / "dauam-2", monkeypatch)


def own_folders(plan: RoomPlan) -> RoomPlan:
    """Give each vehicle's records a folder of their own."""
    return replace(
        plan,
        configs=tuple(
            one.model_copy(
                update={"records": one.records.model_copy(update={"folder": f"{one.records.folder}/{one.mocap.body}"})}
            )
            for one in plan.configs
        ),
    )


@asynccontextmanager
async def room(plan: RoomPlan, folder: Path) -> AsyncIterator[list[Reader]]:
    """Two vehicles 3.4 m apart with their services; yield a reader of each."""
    there = BrokerProcess()
    there.port = plan.broker.port
    there.start()
    async with AsyncExitStack() as stack:
        stack.callback(there.stop)
        mocks = await stack.enter_async_context(mock_process(mock_config(folder), 1, plan.ports))
        assert mocks.stdin is not None
        mocks.stdin.write(b"carry vehicle 1: 0 0 0\ncarry vehicle 2: 0 -3.4 0\n")
        services = [
            await stack.enter_async_context(serving(path, path.with_suffix(".log"))) for path in plan.write(folder)
        ]
        readers = []
        for service, place in zip(services, plan.endpoints(), strict=True):
            await service.says("the vehicle is there")
            readers.append(Reader(place, await stack.enter_async_context(looking_on(place, service))))
        yield readers


def two_vehicles(code: int, out: str, errors: str) -> None:
    assert (code, errors) == (0, "")
    assert out.count("the path is flown, it hovers at its end") == 2
    assert out.count("down and disarmed") == 2
    (least_m,) = re.findall(r"dauam-1 and dauam-2 were never nearer than (\S+) m", out)
    assert 3.0 < float(least_m) < 3.5


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
        "ValueError: hold at 0.4 m\ndauam-2: landed because of ValueError('hold at 0.4 m'): down and dis" in traceback
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
    folder.rename(folder.parent.parent / "of_laws")
    (folder.parent.parent / "notebooks" / "here").mkdir(parents=True)
    (folder.parent.parent / "notebooks" / "flights").symlink_to("../of_laws")
    monkeypatch.chdir(folder.parent.parent / "notebooks" / "here")
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
