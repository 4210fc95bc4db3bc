"""A session of several trajectories: numbers, curves and comparisons of each, and none of what was never flown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from companion.analysis.report.charts import Medium
from companion.analysis.report.compare import overlaid
from companion.analysis.report.comparison import comparison
from companion.analysis.report.control_figures import whole_cycle_bins
from companion.analysis.report.figures import charts_of
from companion.analysis.report.number_tables import error_table, head, trajectory_table, trigger_table
from companion.analysis.report.numbers import Numbers, numbers_of
from companion.analysis.report.page import chapter_of, page
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.summary import summary, verdict
from companion.analysis.report.tables import GOOD
from companion.analysis.report.trajectories import runs, trajectory_name
from companion.core.types import Array
from companion.flight.tick import Tick
from companion.records.read import RecordedEvent
from companion.supervisor.flight_state import Phase
from tests.analysis.session import Session, session

pytestmark = pytest.mark.slow

OVER_TIME = ("timeline", "position", "errors", "command", "events", "friction", "weights", "signals", "thrust")


@pytest.fixture(scope="module")
def flown_session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return session(tmp_path_factory.mktemp("session"))


@pytest.fixture(scope="module")
def numbers(flown_session: Session) -> Numbers:
    return numbers_of(flown_session.flown)


def tracked(flown_session: Session) -> list[list[Tick]]:
    """Ticks of each run of phase track."""
    found: list[list[Tick]] = []
    before = None
    for tick in flown_session.flight.ticks:
        if tick.flight.phase is Phase.TRACK:
            if before is not Phase.TRACK:
                found.append([])
            found[-1].append(tick)
        before = tick.flight.phase
    return found


def test_each_trajectory_has_its_name_its_law_and_its_cycles_and_a_goto_is_none(
    flown_session: Session, numbers: Numbers
) -> None:
    goto, ellipse, eight = tracked(flown_session)
    assert len(goto) == 1, "a goto ends with one cycle of phase track"
    assert [(one.name, one.law) for one in numbers.trajectories] == [("ellipse", "etnn"), ("figure8", "pid")]
    for one, ticks in zip(flown_session.flown.trajectories, (ellipse, eight), strict=True):
        assert one.mask.sum() == len(ticks)
        assert one.begin_s + flown_session.flown.zero_s == pytest.approx(ticks[0].time_s)


def test_errors_are_those_of_the_trajectory_alone(flown_session: Session, numbers: Numbers) -> None:
    _, *both = tracked(flown_session)
    for one, ticks in zip(numbers.trajectories, both, strict=True):
        size_m = []
        for tick in ticks:
            assert tick.vehicle is not None
            assert tick.reference is not None
            now_m = tick.vehicle.position_w_m + tick.age_s * tick.vehicle.velocity_w_mps
            size_m.append(float(np.linalg.norm(now_m - tick.reference.position_w_m)))
        assert one.errors is not None
        assert one.errors.max_m[3] == pytest.approx(max(size_m))
        assert one.errors.mean_m[3] == pytest.approx(np.mean(size_m))
    ellipse, eight = numbers.trajectories
    assert ellipse.errors is not None
    assert eight.errors is not None
    assert eight.errors.mean_m[3] > 3.0 * ellipse.errors.mean_m[3], "an average of both would say neither"


def test_the_pause_between_two_trajectories_is_no_gap(flown_session: Session, numbers: Numbers) -> None:
    longest_s = []
    for ticks in tracked(flown_session)[1:]:
        fired = [
            tick.time_s for tick in ticks if tick.pipeline is not None and bool(tick.pipeline.law_output.event.any())
        ]
        longest_s.append(float(np.diff(fired).max()))
    assert [one.triggers.gap_max_s for one in numbers.trajectories if one.triggers] == pytest.approx(longest_s)
    first, second = numbers.trajectories
    assert second.begin_s - first.begin_s - first.duration_s > 5.0, "the pause"


def test_missing_cycles_end_a_stretch() -> None:
    among = np.array([False, True, True, True, False, True])
    assert runs(among, np.array([1.0, 2.0, 3.0, 7.0, 8.0, 9.0])).tolist() == [-1, 0, 0, 1, -1, 2]
    assert runs(among, np.full(6, np.nan)).tolist() == [-1, 0, 0, 0, -1, 1]


def test_a_trajectory_is_named_after_the_last_command_before_it() -> None:
    events = [
        RecordedEvent(1.0, "command", "track curve=ellipse laps=2"),
        RecordedEvent(3.0, "command", "track laps=2 period_s=15.0 size=1.0"),
        RecordedEvent(5.0, "reply", "track done"),
        RecordedEvent(6.0, "command", "goto x_m=1.0"),
        RecordedEvent(7.0, "command", "arms do=stow"),
    ]
    names = [trajectory_name(events, at_s, "demo's") for at_s in (0.5, 2.0, 4.0, 8.0)]
    assert names == ["demo's", "ellipse", "waypoints", ""]


def test_tables_and_head_have_a_row_for_each_trajectory(numbers: Numbers) -> None:
    grids = [trajectory_table(numbers), error_table(numbers), trigger_table(numbers)]
    firsts = [[row[0].text for row in grid.rows if row[0].text] for grid in grids if grid is not None]
    assert firsts[0] == ["1: ellipse", "2: figure8"]
    assert [name.split(",")[0] for name in firsts[1]] == ["1: ellipse", "2: figure8", "in the air"]
    assert firsts[2] == ["1: ellipse, etnn", "2: figure8, pid", "in the air"]
    assert dict(head(numbers))["in the air"] == f"{numbers.law_s:.1f} s"


def test_the_page_begins_with_a_verdict_and_two_lines(numbers: Numbers) -> None:
    said = verdict(numbers)
    assert (said.text, said.tone) == ("Landed and disarmed. No fault.", GOOD)
    first, second = summary(numbers)
    assert first.startswith("Ellipse by etnn: mean error ")
    assert "; Figure8 by pid: mean error " in first
    assert "the longest time between two triggers was" in second


def lines(axes: Axes) -> list[Array]:
    return [np.asarray(line.get_xydata(), np.float64) for line in axes.get_lines()]


def longest_step(path: Array) -> float:
    """Between neighbouring points of a curve; NaN breaks it."""
    return float(np.nanmax(np.linalg.norm(np.diff(path, axis=0), axis=1)))


def test_the_path_has_no_line_that_was_never_flown(flown_session: Session) -> None:
    flown = flown_session.flown
    charts = {chart.name: chart for chart in charts_of(flown, numbers_of(flown).story)}
    (above,) = charts["above"].figure(Medium.PAGE).axes
    paths = lines(above)
    assert len(paths) == 3
    assert all(longest_step(path) < 0.05 for path in paths), "half a metre lies between the two trajectories"
    assert np.isfinite(paths[1][:, 0]).sum() == flown.tracked.sum()
    position = charts["position"].figure(Medium.PAGE).axes[2]
    assert all(np.nanmin(path[:, 1]) > -0.05 for path in lines(position)), "no reference below the floor"


def test_the_same_second_stands_at_the_same_place_in_all_figures_over_time(flown_session: Session) -> None:
    flown = flown_session.flown
    for medium, names in ((Medium.PAGE, OVER_TIME), (Medium.PAPER, OVER_TIME[::4])):
        edges = set()
        for chart in charts_of(flown, numbers_of(flown).story):
            if chart.name in names:
                for axes in chart.figure(medium).axes:
                    place, shown_s = axes.get_position(), axes.get_xlim()
                    edges.add((round(place.x0, 6), round(place.x1, 6), *shown_s))
        assert len(edges) == 1


def test_flights_are_compared_trajectory_by_trajectory_from_their_own_start(flown_session: Session) -> None:
    both = flown_session.flown
    first, second = both.trajectories
    alone = Flown(
        replace(
            both.record, columns={name: c[both.time_s > first.end_s + 1.0] for name, c in both.record.columns.items()}
        )
    )
    assert [one.name for one in alone.trajectories] == ["figure8"]
    charts = {chart.name: chart for chart in overlaid([both, alone])}
    assert charts.keys() == {"compared-ellipse", "compared-figure8"}
    norm = charts["compared-figure8"].figure(Medium.PAGE).axes[3]
    a, b, _ = lines(norm)
    assert a[0, 0] == b[0, 0] == 0.0
    assert a[-1, 0] == pytest.approx(second.end_s - second.begin_s, abs=0.05)
    np.testing.assert_array_equal(a[:, 1], b[:, 1])
    grid = comparison([numbers_of(both), numbers_of(alone)])
    assert [(row[0].text, row[1].text, row[2].text) for row in grid.rows] == [
        ("A1", "etnn", "ellipse"), ("A2", "pid", "figure8"), ("B", "pid", "figure8"),
    ]  # fmt: skip


@pytest.mark.parametrize("top_ms", [10.0, 20.0, 590.0, 601.0, 668.0, 1205.0])
def test_a_histogram_of_whole_cycles_holds_the_longest_gap(top_ms: float) -> None:
    edges = whole_cycle_bins(top_ms)
    assert edges[0] < 10.0
    assert edges[-1] >= top_ms
    assert len(edges) <= 63


def test_the_page_hides_where_the_laws_files_were_and_names_the_colours(flown_session: Session, tmp_path: Path) -> None:
    flown = flown_session.flown
    columns = flown.record.columns
    path = "/home/somebody/laws/mine.toml"
    elsewhere = np.where(columns["law_name"] == "pid", path, columns["law_name"])
    laws = {path: "law = 1"}
    moved = replace(flown.record, columns=columns | {"law_name": elsewhere}, metadata={"laws": laws})
    chapter = chapter_of(Flown(moved))
    html = page([replace(chapter, charts=chapter.charts[:1])], lambda _: None)
    assert "/home/somebody" not in html
    assert "Law mine.toml" in html
    for phase in ("takeoff", "hold", "track", "land"):
        assert f">{phase}</span>" in html
