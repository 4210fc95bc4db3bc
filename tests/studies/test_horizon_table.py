"""The table of errors under each horizon."""

from pathlib import Path

import pytest

from companion.simulation.scene import HorizonError
from companion.studies.paper.campaign import fly
from companion.studies.paper.horizon_table import HEAD, SETTINGS, Setting, row, row_items
from tests.studies.short_experiments import short_experiment

pytestmark = pytest.mark.slow


def test_a_row_has_the_law_with_and_without_the_correction_on_both_experiments(tmp_path: Path) -> None:
    both = str(short_experiment(tmp_path / "a.toml")), str(short_experiment(tmp_path / "b.toml"))
    setting = Setting(name="short", experiments=both)
    items = row_items(setting, HorizonError.PX4_TIGHT, "practical", (1, 2))
    flights = [fly(item) for item in items]
    cells = [cell.strip() for cell in row(setting, HorizonError.PX4_TIGHT, "practical", flights).strip("|").split("|")]
    assert cells[:3] == ["short", "px4-tight", f"{flights[0].error_m:.4f}"]
    assert cells[5] == f"{flights[2].error_m:.4f}, {flights[2].update_share:.1%}"
    assert not items[2].corrected
    assert len(cells) == HEAD.splitlines()[0].count("|") - 1


def test_the_papers_experiments_are_flown_with_their_baseline_and_the_recorded_vehicles_without() -> None:
    laws = [{item.controller for item in row_items(one, HorizonError.RANDOM, "practical", (1,))} for one in SETTINGS]
    assert laws == [{"practical", "pid"}, {"practical", "pid"}, {"practical"}]
