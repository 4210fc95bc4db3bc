"""The table and the picture of the radio's price."""

from pathlib import Path

import numpy as np
import pytest

from companion.core.interfaces import CompanionError
from companion.studies.paper.radio_plot import draw
from companion.studies.paper.radio_table import (
    BEGIN,
    END,
    HEAD,
    RADIOS,
    TRIGGERS,
    fly,
    row,
    table,
    tasks,
    times,
    write_page,
)
from tests.flights.command import ROOT
from tests.studies.short_experiments import short_experiment

pytestmark = pytest.mark.slow


def test_radios_of_one_age_fly_side_by_side_and_every_one_is_in_a_row(tmp_path: Path) -> None:
    experiment = str(short_experiment(tmp_path / "short.toml"))
    radios = ("delay 2 ms", "loss 30% delay 2 ms", "delay 2 ms jitter 50 ms")
    work = [task for task in tasks((1, 2), radios, (experiment,)) if task.trigger == "practical"]
    assert [task.radios for task in work] == [(), radios[:2], radios[2:]]
    results = [result for task in work for result in fly(task)]
    board, good, bad, jitter = results
    assert [one.radio for one in results] == ["", *radios]
    lines = table(results, radios).splitlines()
    assert len(lines) == 2 + len(TRIGGERS) * 4
    assert lines[2] == "| none: every cycle | on board | not flown yet | | | | | | | | |"
    assert lines[-4:] == [row("practical", one.radio, [one], [board]) for one in (board, good, bad, jitter)]
    link = bad.link
    assert link is not None
    cells = [cell.strip() for cell in lines[-2].strip("|").split("|")]
    assert cells[:3] == ["practical", "loss 30% delay 2 ms", f"{np.mean(bad.errors_m):.4f}"]
    assert cells[-3:] == [f"{link.uplink_bytes_per_s:.0f}", f"{link.again / bad.flight_s:.1f}", "0"]
    assert times([board], [board]) == 1.0
    picture = tmp_path / "radio.png"
    draw(results, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_table_is_written_between_the_marks_of_its_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\n\nold\n\n{END}\nafter\n", encoding="utf-8")
    write_page(page, "new")
    write_page(page, "newer")
    assert page.read_text(encoding="utf-8") == f"before\n{BEGIN}\n\nnewer\n\n{END}\nafter\n"
    page.write_text("no marks", encoding="utf-8")
    with pytest.raises(CompanionError, match="has no '<!-- radio"):
        write_page(page, "new")


def test_the_page_has_a_row_for_every_trigger_and_radio() -> None:
    page = (ROOT / "docs" / "radio.md").read_text(encoding="utf-8")
    rows = page.partition(BEGIN)[2].partition(END)[0].strip().splitlines()
    assert rows[:2] == HEAD.splitlines()
    heads = [[cell.strip() for cell in row.split("|")[1:3]] for row in rows[2:]]
    assert heads == [[trigger, radio] for trigger in TRIGGERS for radio in ("on board", *RADIOS)]
    assert {row.count("|") for row in rows} == {12}
