"""The demo of several vehicles without flying it: files, ports, numbers, verdict, lines."""

import io
import socket
import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from rich.console import Console

from companion.cli.demo.fleet import mission
from companion.cli.demo.fleet.command import _wrong
from companion.cli.demo.fleet.display import FleetDisplay
from companion.cli.demo.fleet.flight import FleetFlown
from companion.cli.demo.fleet.mission import Mission, lap_waypoints
from companion.cli.demo.fleet.report import VehicleReport, as_dict, plot_fleet, separations
from companion.cli.demo.fleet.room import LANE_M, plan_room
from companion.cli.demo.fleet.toml_text import toml_of
from companion.cli.demo.mock_process import FaultTold, _fault_told
from companion.client.command_draft import CommandDraft
from companion.client.errors import RejectedError
from companion.config.companion_config import load_config
from companion.config.controller_config import ErrorLimits
from companion.config.locations import default_config_path
from companion.config.separation_config import SeparationConfig
from companion.core.errors import FlightError
from companion.core.types import Array
from companion.protocol.telemetry import Answer, Happened, Kind, Reply, State
from companion.records.flight_record import FlightRecord
from tests.cli.typed import typing

SETTINGS = load_config(default_config_path("demo.toml"))
RULES = SeparationConfig(order=("a", "b"))


def test_each_vehicle_has_a_file_of_its_own_that_reads_as_it_was_planned(tmp_path: Path) -> None:
    plan = plan_room(SETTINGS, 3, tmp_path, free=True)
    assert plan.names == ("dauam-1", "dauam-2", "dauam-3")
    paths = plan.write(tmp_path)
    assert [path.name for path in paths] == ["dauam-1.toml", "dauam-2.toml", "dauam-3.toml"]
    assert tuple(map(load_config, paths)) == plan.configs
    client, autopilot = plan.ports.client, plan.ports.autopilot
    assert client is not None
    assert autopilot == client + 3
    for index, (name, config) in enumerate(zip(plan.names, plan.configs, strict=True)):
        assert (config.px4.url, config.px4.system_id) == (f"udpin://127.0.0.1:{client + index}", index + 1)
        assert (config.mocap.body, config.mocap.port) == (name, plan.ports.qualisys)
        assert config.operator == plan.broker.model_copy(update={"vehicle": name})
        assert config.separation.order == plan.names
        assert config.arms is not None
        assert config.arms.port == f"{plan.ports.servo_link}-{index + 1}"
    assert plan.ports.arguments()[-2:] == ["--vehicles", "3"]


def test_without_free_ports_the_rule_of_px4_counts_and_a_broker_that_runs_is_left_alone(tmp_path: Path) -> None:
    with ExitStack() as stack:
        taken = stack.enter_context(socket.socket())
        try:
            taken.bind(("127.0.0.1", 1883))
        except OSError:
            pass  # somebody else's broker: the same
        else:
            taken.listen()
        plan = plan_room(SETTINGS, 2, tmp_path, free=False)
    assert [config.px4.url for config in plan.configs] == ["udpin://127.0.0.1:14540", "udpin://127.0.0.1:14541"]
    assert plan.broker.port != 1883


def test_toml_is_read_as_it_was_given() -> None:
    data: dict[str, Any] = {
        "plain": 1,
        "left": None,
        "table": {"text": 'a "b" \\ ü', "flag": True, "number": 1.5, "far": float("inf"), "list": [1, [2.5, "x"]]},
        "deep": {"rows": [{"a": 1, "b": {"c.d": False}}], "none": None},
        "empty": {},
    }
    read = tomllib.loads(toml_of(data))
    assert read == {
        "plain": 1,
        "table": data["table"],
        "deep": {"rows": [{"a": 1, "b": {"c.d": False}}]},
        "empty": {},
    }


def test_laps_begin_and_end_at_rest_in_the_lane() -> None:
    rows = lap_waypoints(1.3, 1.2, 2)
    assert len(rows) <= 400
    assert rows[0] == pytest.approx([0.0, 0.8, 1.3, 1.2])
    assert rows[-1, 1:] == pytest.approx(rows[0, 1:])
    assert abs(rows[:, 2] - 1.3).max() == pytest.approx(0.4, abs=0.01)
    assert LANE_M - 2.0 * 0.4 > 1.5, "the margin of separation, whatever their phase"


def report(name: str, y_m: float, height_m: Array, begin_s: float = 0.0) -> VehicleReport:
    """A vehicle that flies at one y, seen 100 times a second."""
    times_s = begin_s + 0.01 * np.arange(len(height_m))
    places = np.column_stack([np.zeros_like(height_m), np.full_like(height_m, y_m), height_m])
    columns = {
        "time_s": times_s,
        "position_w_m": places,
        "airborne": height_m > 0.0,
        "phase": np.full(len(height_m), "hold"),
    }
    record = FlightRecord(path=Path(f"{name}.mcap"), columns=columns)
    return VehicleReport(name, Path(f"{name}.mcap"), record, None)


def test_separation_counts_where_one_flies_and_the_heights_are_near() -> None:
    ground, low, high = np.zeros(100), np.full(100, 1.0), np.full(100, 3.0)
    climbs = np.concatenate([ground, low])
    (both,) = separations([report("a", 0.0, climbs), report("b", 1.4, climbs, 0.5)], RULES)
    assert both.least_m == pytest.approx(1.4)
    assert not np.isfinite(both.distance_m[0]), "both stand"
    (over,) = separations([report("a", 0.0, low), report("b", 0.3, high)], RULES)
    assert over.least_m == pytest.approx(0.3), "at any height"
    may_cross = RULES.model_copy(update={"height_m": 1.6})
    (over,) = separations([report("a", 0.0, low), report("b", 0.3, high)], may_cross)
    assert over.least_m == np.inf
    (beside,) = separations([report("a", 0.0, low), report("b", 0.3, ground)], RULES)
    assert beside.least_m == pytest.approx(0.3)


def test_the_picture_of_a_flight_that_tracked_nothing_is_drawn(tmp_path: Path) -> None:
    reports = [report("a", 0.0, np.full(300, 1.0)), report("b", 2.0, np.full(300, 1.0))]
    plot_fleet(reports, separations(reports, RULES), RULES, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def wrong(flown: FleetFlown, y_m: float = 2.0) -> list[str]:
    plan: Any = type("Plan", (), {"names": ("a", "b"), "separation": RULES})
    options: Any = type("Options", (), {"law": type("Law", (), {"name": "etnn", "error_limits": ErrorLimits()})})
    reports = (report("a", 0.0, np.full(100, 1.0)), report("b", y_m, np.full(100, 1.0)))
    pairs = separations(reports, RULES)
    assert as_dict(reports, pairs)["least_separation_m"] == pytest.approx({"a b": y_m})
    return _wrong(options, plan, flown, reports, pairs)


def test_the_verdict_names_everything_that_went_wrong() -> None:
    down = {"a": True, "b": True}
    assert wrong(FleetFlown(landed=down)) == []
    assert wrong(FleetFlown(landed=down), 1.19) == ["a and b came within 1.19 m, at least 1.2 m are wanted"]
    assert wrong(FleetFlown(landed={"a": True}, failure="no", collisions=["a and b"])) == [
        "no",
        "collision: a and b",
        "b is not known to be down and disarmed",
    ]


def test_repeated_warnings_and_refusals_are_shown_once() -> None:
    out = io.StringIO()
    display = FleetDisplay(Console(file=out, width=200))

    def tell(kind: Kind, name: str, reaction: str = "") -> None:
        display.tell("dauam-1", Happened(time_s=0.0, kind=kind, text="words", name=name, reaction=reaction))

    for _ in range(2):
        tell(Kind.FAULT, "mocap late", "warn")
        tell(Kind.FAULT_ENDS, "mocap late")
        tell(Kind.REPLY, "goto refused")
        tell(Kind.COMMAND, "goto")
        tell(Kind.FAULT, "traffic", "hold")
        tell(Kind.FAULT_ENDS, "traffic")
    tell(Kind.REPLY, "goto accepted")
    tell(Kind.REPLY, "goto refused")
    display.tell_of_mocks(FaultTold("collision", "dauam-1 and dauam-2", 1.0))
    shown = [line.split(" s  ")[1].strip() for line in out.getvalue().splitlines()]
    assert shown == [
        "dauam-1  fault: mocap late: words -> warn",
        "dauam-1  reply goto refused: words",
        "dauam-1  fault: traffic: words -> hold",
        "dauam-1  over: traffic",
        "dauam-1  fault: traffic: words -> hold",
        "dauam-1  over: traffic",
        "dauam-1  reply goto refused: words",
        "mocks    collision: dauam-1 and dauam-2",
    ]


def test_a_collision_is_a_notice_of_the_mocks() -> None:
    assert _fault_told("collision at 12.345 s (monotonic): a and b") == FaultTold("collision", "a and b", 12.345)


@pytest.mark.parametrize("words", [("--compare", "pid"), ("--law-on", "ground"), ("--trajectory", "figure8")])
def test_options_of_one_vehicle_are_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    typed = typing("demo", monkeypatch, capsys)("--vehicles", "2", *words)
    assert (typed.code, typed.out) == (2, "")
    assert typed.err.startswith(
        "companion: --vehicles 2: flies laps and crossing ways, laws on board: leave out --traj"
    )


class Stub:
    """A vehicle that does what it is told at once; `refusals` of its next ways are refused."""

    def __init__(self, name: str, log: list[str]) -> None:
        self.name, self._log, self.refusals, self.fails = name, log, 0, ""
        self.state = State(time_s=0.0, session="a", phase="hold")

    def __getattr__(self, verb: str) -> Any:
        async def done(*_: object, **__: object) -> str:
            self._log.append(f"{self.name} {verb}")
            if verb == self.fails:
                raise FlightError(f"{verb} failed")
            return ""

        return done

    async def wait_until(self, *_: object, **__: object) -> State:
        return self.state

    async def execute(self, draft: CommandDraft, hear: Callable[[Reply], None]) -> None:
        self._log.append(f"{self.name} {draft.verb}")
        answer = Answer.REFUSED if self.refusals else Answer.ACCEPTED
        reply = Reply(id=draft.id, answer=answer, time_s=0.0, text=f"{answer} way")
        if self.refusals:
            self.refusals -= 1
            raise RejectedError(draft.verb, reply)
        hear(reply)


@pytest.fixture
def crew(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[Mission, list[Stub], list[str]]:
    """A mission of two, and all that is done and said in it."""
    for name in ("_AGAIN_S", "_SETTLED_S"):
        monkeypatch.setattr(mission, name, 0.0)
    log: list[str] = []
    stubs = [Stub("one", log), Stub("two", log)]
    plan = plan_room(SETTINGS, 2, tmp_path, free=True)
    return Mission(plan, cast(Any, tuple(stubs)), log.append, None), stubs, log


async def test_the_mission_asks_again_for_a_way_that_is_refused(crew: tuple[Mission, list[Stub], list[str]]) -> None:
    flown, stubs, log = crew
    stubs[1].refusals = 3
    await flown.fly(2)
    assert [line for line in log if line.startswith("two ")] == [
        "two arm", "two takeoff", *["two goto"] * 4, "two track", "two goto", "two goto", "two land"
    ]  # fmt: skip
    assert [line for line in log if line.endswith(" hold")] == ["one hold"]
    assert "two: accepted way" in log


async def test_an_error_of_the_mission_names_its_vehicle(crew: tuple[Mission, list[Stub], list[str]]) -> None:
    flown, stubs, log = crew
    stubs[1].fails = "track"
    with pytest.raises(FlightError, match=r"^two: track failed$"):
        await flown.fly(2)
    assert "one track" in log, "the other one flies to the end of its laps"
    assert "one land" not in log
