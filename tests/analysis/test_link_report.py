"""The page on the link of a flight whose law was on the ground: numbers, table and figures."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

from companion.analysis.report.charts import Medium
from companion.analysis.report.link_numbers import limits_of, link_numbers
from companion.analysis.report.link_table import link_table
from companion.analysis.report.page import chapter_of, page
from companion.analysis.report.recorded_flight import GROUND_TO_SETPOINT, Flown
from companion.config.companion_config import CompanionConfig
from companion.records.read import read_flight
from tests.records.flown import flight
from tests.records.linked import DOWN_S, UP_S, flight_with_link
from tests.records.test_round_trip import written

AGE_S = 0.5 * (UP_S + DOWN_S)
"""Age that the ends can know: half of the round trip."""
LIMITS = CompanionConfig().safety


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    ticks = flight_with_link(track_s=4.0, lose=5)
    begin = {"unix_offset_s": 1.7e9, "config": CompanionConfig().model_dump(mode="json")}
    (path,) = written(tmp_path_factory.mktemp("records"), ticks, begin)
    return Flown(read_flight(path))


def test_numbers_are_those_of_the_messages(flown: Flown) -> None:
    tracked, whole = link_numbers(flown)
    assert (tracked.name, whole.name) == ("trajectory", "in the air")
    assert tracked == replace(whole, name="trajectory")
    assert whole.duration_s == pytest.approx(4.0, abs=0.02)
    assert whole.cycles_per_s == pytest.approx(100.0, rel=0.01)
    assert whole.events == pytest.approx(4.0 / 0.07, abs=1.5)
    messages = whole.events + whole.again + whole.beats
    assert whole.messages_per_s == pytest.approx(messages / whole.duration_s, rel=0.05)
    assert whole.lost == pytest.approx(messages / 5, abs=2)
    assert whole.again > 3, "a lost command is sent again"
    assert whole.age_median_s == pytest.approx(AGE_S, abs=3e-4)
    assert whole.age_median_s <= whole.age_p99_s <= whole.age_max_s
    assert 0.03 < whole.silence_max_s < 0.1
    assert whole.messages_down_per_s >= 20.0
    assert whole.bytes_per_s > 20.0 * whole.messages_per_s


def test_the_table_has_a_row_for_the_trajectory_and_one_for_the_flight(flown: Flown) -> None:
    grid = link_table(link_numbers(flown))
    assert grid is not None
    assert [row[0].text for row in grid.rows] == ["trajectory", "in the air"]
    assert all(len(row) == len(grid.columns) for row in grid.rows)
    assert "a plain stream would send 100 a second" in grid.note
    lost = grid.rows[-1][grid.columns.index("lost")].text
    assert float(lost.removesuffix("%")) == pytest.approx(20.0, abs=1.0)


def test_limits_of_silence_are_the_configured_ones(flown: Flown) -> None:
    assert limits_of(flown) == {
        "late": LIMITS.command_late_s,
        "held until": LIMITS.command_coast_s,
        "level": LIMITS.command_level_s,
        "PX4 lands": LIMITS.command_silent_s,
    }
    assert limits_of(Flown(replace(flown.record, metadata={}))) == {}


def test_the_page_shows_the_link(flown: Flown) -> None:
    chapter = chapter_of(flown)
    assert {"link", "message_ages", "message_gaps"} <= {chart.name for chart in chapter.charts}
    few = [chart for chart in chapter.charts if chart.name in {"timeline", "link", "message_ages", "message_gaps"}]
    text = page([replace(chapter, charts=few)], lambda _: None)
    for words in ("Link to the law on the ground", "longest silence (ms)", "etnn on the ground", "Dashed: what"):
        assert words in text, words
    session = int(flown.column("link_session")[-1])
    assert f"<dt>side of the link</dt><dd>vehicle; session {session}</dd>" in text
    assert chapter.numbers.as_dict()["link"][-1]["name"] == "in the air"


def test_the_figure_has_the_next_limit_above_what_was_reached(flown: Flown) -> None:
    (chart,) = [chart for chart in chapter_of(flown).charts if chart.name == "link"]
    silence = chart.figure(Medium.PAGE).axes[-1]
    assert [text.get_text() for text in silence.texts] == ["late"]
    chart.save(BytesIO(), Medium.PAPER)


def test_a_flight_of_one_cycle_is_drawn(flown: Flown) -> None:
    rows = flown.time_s <= 0.0
    short = Flown(replace(flown.record, columns={name: values[rows] for name, values in flown.record.columns.items()}))
    assert short.airborne.sum() == 1
    for chart in chapter_of(short).charts:
        if chart.name in {"link", "message_ages", "message_gaps"}:
            chart.figure(Medium.PAGE)


def test_the_way_of_a_command_is_a_latency_of_its_own(flown: Flown) -> None:
    latency_s = flown.latencies_s()[GROUND_TO_SETPOINT]
    assert len(latency_s) == flown.event[flown.airborne].sum()
    usual_s = 0.012 + AGE_S + 0.0005
    assert np.median(latency_s) == pytest.approx(usual_s, abs=5e-4)
    assert latency_s.max() > usual_s + 0.01, "commands that were sent again are older"


def test_a_law_on_board_has_none_of_it(tmp_path_factory: pytest.TempPathFactory) -> None:
    (path,) = written(tmp_path_factory.mktemp("records"), flight())
    flown = Flown(read_flight(path))
    assert link_numbers(flown) == ()
    assert chapter_of(flown).numbers.side == ""
    assert link_table(()) is None
    assert GROUND_TO_SETPOINT not in flown.latencies_s()
    assert "link" not in {chart.name for chart in chapter_of(flown).charts}
