"""One flight of each fault: its reaction, in time, inside the fence. `make faults` flies the whole table."""

import multiprocessing
import re
from pathlib import Path

import pytest

from companion.supervisor.faults import TABLE, Fault
from tests.flights.faults.drift import Drift
from tests.flights.faults.judge import Result
from tests.flights.faults.report import FLOWN, PAGE, RECOGNISED, flown, part, read_json, recognised, write_json
from tests.flights.faults.table import VIRTUAL
from tests.flights.faults.table_real import REAL
from tests.flights.faults.virtual import fly_named

pytestmark = pytest.mark.slow

HERE = (
    Fault.MOCAP_DEGRADED, Fault.MOCAP_FROZEN, Fault.MOCAP_SLOW, Fault.ATTITUDE_DISAGREES, Fault.HORIZON_WRONG,
    Fault.HORIZON_LOST, Fault.SETPOINT_NOT_FOLLOWED, Fault.FENCE_LEFT, Fault.ROOM_LEFT, Fault.HOLD_TOO_LONG,
    Fault.BATTERY_LOW, Fault.ARMS, Fault.KILL, Fault.GROUND_LAW_SILENT, Fault.COMMANDS_FOREIGN,
)  # fmt: skip
"""One flight each; every reaction is among them. Silence and jumps of motion capture, failing laws, a silent autopilot
and a pilot are flown in test_simulated_flights.py and test_simulated_safety.py."""


def test_every_fault_of_the_reaction_table_is_flown() -> None:
    assert {row.fault for row in TABLE} == {row.fault for row in (*VIRTUAL, *REAL)}


def test_names_are_unique() -> None:
    rows = (*VIRTUAL, *REAL)
    assert len({row.name for row in rows}) == len(rows)


def test_flights_in_simulated_time() -> None:
    first: dict[Fault, str] = {}
    for row in VIRTUAL:
        first.setdefault(row.fault, row.name)
    with multiprocessing.Pool() as workers:
        results = workers.map(fly_named, [first[fault] for fault in HERE], chunksize=1)
    assert [(result.name, result.problems) for result in results if result.problems] == []


def flown_by(drift_m: float, problems: tuple[str, ...] = ()) -> dict[str, Result]:
    """Return results of every row, as if PX4 had landed without a pose."""
    return {row.name: Result(row.name, row.ends, 0.1, 1.0, -1.0, 0.5, drift_m, "", problems) for row in VIRTUAL}


@pytest.mark.parametrize(("drift_m", "as_recorded"), [(0.2, False), (0.5, True), (2.0, False)])
def test_blind_landings_must_drift_as_the_recorded_ones(drift_m: float, as_recorded: bool) -> None:
    assert (Drift(flown_by(drift_m)).problems == []) is as_recorded


def test_an_interrupted_run_keeps_what_was_right(tmp_path: Path) -> None:
    write_json(flown_by(0.5), tmp_path / "right.json")
    write_json(flown_by(0.5, ("it is not down",)), tmp_path / "wrong.json")
    assert read_json(tmp_path / "right.json") == flown_by(0.5)
    assert read_json(tmp_path / "wrong.json") == read_json(tmp_path / "none.json") == {}


def test_the_page_prints_the_reaction_table() -> None:
    assert part(PAGE.read_text(encoding="utf-8"), RECOGNISED) == recognised(), "run `make faults`"


def test_the_page_prints_the_flights() -> None:
    def without_measured(table: str) -> list[str]:
        return [re.sub(r"[^|]*\|[^|]*\|$", "", line) for line in table.splitlines()]

    printed = part(PAGE.read_text(encoding="utf-8"), FLOWN)
    assert without_measured(printed) == without_measured(flown((*VIRTUAL, *REAL), {})), "run `make faults`"
