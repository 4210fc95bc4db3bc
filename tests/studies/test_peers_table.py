"""The table of all laws: with and without triggers, and virtual flights within half again of what was measured."""

from pathlib import Path

import pytest

from companion.studies.paper.campaign import Item, fly
from companion.studies.paper.horizon_table import Setting
from companion.studies.paper.peers_table import HEAD, LAWS, row, row_items
from tests.studies.short_experiments import short_experiment

pytestmark = pytest.mark.slow


def test_a_law_has_a_row_with_its_trigger_and_one_without_and_the_baseline_one(tmp_path: Path) -> None:
    both = str(short_experiment(tmp_path / "a.toml")), str(short_experiment(tmp_path / "b.toml"))
    setting = Setting(name="short", experiments=both)
    rows = [row(setting, [fly(item) for item in items]) for items in row_items(setting, "indi", (1, 2))]
    cells = [[cell.strip() for cell in one.strip("|").split("|")] for one in rows]
    assert [one[:3] for one in cells] == [["short", "`indi`", "on"], ["short", "`indi`", "off"]]
    assert float(cells[0][5].rstrip("%")) < 50.0
    assert cells[1][5] == cells[1][8] == "100.0%"
    assert all(len(one) == HEAD.splitlines()[0].count("|") - 1 for one in cells)
    assert [len([*row_items(setting, law, (1,))]) for law in LAWS] == [2, 2, 2, 2, 2, 1]


@pytest.mark.parametrize(
    ("law", "most_m", "most_sent"),
    [("geometric-pid", 0.067, 0.042), ("indi", 0.025, 0.055), ("l1", 0.055, 0.08), ("mpc", 0.023, 0.047)],
)
def test_each_peer_flies_the_papers_ellipse(law: str, most_m: float, most_sent: float) -> None:
    """Half again of the error and of the updates that were measured on these seeds."""
    flown = fly(Item(experiment="ellipse", controller=law, seeds=(101, 102)))
    assert flown.diverged == 0
    assert flown.error_m < most_m
    assert flown.update_share < most_sent
