"""The report of recorded virtual flights: its numbers are the flight's, and the page needs nothing but itself."""

import asyncio
import json
import re
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from io import BytesIO
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from companion.analysis.report.charts import Chart, Medium
from companion.analysis.report.compare import overlaid
from companion.analysis.report.comparison import comparison
from companion.analysis.report.figures import charts_of
from companion.analysis.report.number_tables import error_table, head
from companion.analysis.report.numbers import numbers_of
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.story import Said, story_of
from companion.analysis.report.summary import summary, verdict
from companion.analysis.report.tables import BAD
from companion.cli.commands import app
from companion.core.interfaces import ConfigError
from companion.records.read import RecordError, read_flight
from companion.supervisor.flight_state import Phase, TrackRequest
from tests.analysis.recorded import recorded
from tests.flights.simulated import Flight, fly
from tests.flights.test_simulated_flights import LAP, UP, ask, until, wait

pytestmark = pytest.mark.slow

DRAWN = ("timeline", "above", "space", "position", "errors", "command", "events", "gaps", "friction", "weights")


@dataclass(frozen=True)
class Recorded:
    flight: Flight
    path: Path
    flown: Flown


@pytest.fixture(scope="module")
def frozen(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Motion capture freezes on the trajectory, and PX4 lands: 25 s of flight."""

    def freeze(flight: Flight) -> bool:
        flight.room.inject("mocap stuck")
        return True

    script = [*UP, ask(TrackRequest(LAP, 0.5)), until(Phase.TRACK), wait(2.0), freeze, until(Phase.DISARMED), wait(0.5)]
    flight = asyncio.run(fly(script))
    begun = next(tick.time_s for tick in flight.ticks if tick.flight.phase is Phase.TAKEOFF)
    told = [(begun, "command", "takeoff <1.2 m>"), (begun + 4.5, "reply", "holds at 1.20 m")]
    ticks = [replace(tick, law="etnn") for tick in flight.ticks]
    path = recorded(ticks, tmp_path_factory.mktemp("record"), told=told, controller={"name": "etnn", "file": "law = 1"})
    return Recorded(flight, path, Flown(read_flight(path)))


def test_errors_are_those_of_the_ticks(frozen: Recorded) -> None:
    numbers = numbers_of(frozen.flown)
    tracked = [tick for tick in frozen.flight.ticks if tick.flight.phase is Phase.TRACK and tick.flight.airborne]
    errors = []
    for tick in tracked:
        assert tick.vehicle is not None
        assert tick.reference is not None
        now = tick.vehicle.position_w_m + tick.age_s * tick.vehicle.velocity_w_mps
        errors.append(np.abs(now - tick.reference.position_w_m))
    assert numbers.tracked is not None
    assert numbers.tracked.cycles == len(tracked)
    np.testing.assert_allclose(numbers.tracked.mean_m[:3], np.mean(errors, axis=0))
    np.testing.assert_allclose(numbers.tracked.max_m[:3], np.max(errors, axis=0))
    np.testing.assert_allclose(numbers.tracked.max_m[3], max(float(np.linalg.norm(error)) for error in errors))


def test_triggers_and_latencies_are_those_of_the_ticks(frozen: Recorded) -> None:
    numbers = numbers_of(frozen.flown)
    flying = [tick for tick in frozen.flight.ticks if tick.flight.airborne]
    fired = [tick.time_s for tick in flying if tick.pipeline is not None and bool(tick.pipeline.law_output.event.any())]
    assert numbers.triggers_whole is not None
    assert numbers.triggers_whole.events == len(fired)
    assert numbers.triggers_whole.gap_max_s == pytest.approx(float(np.diff(fired).max()))
    assert numbers.law_s == pytest.approx(flying[-1].time_s - flying[0].time_s)
    assert numbers.triggers_whole.sent_share == pytest.approx(np.mean([np.isfinite(tick.sent_s) for tick in flying]))
    assert numbers.latencies["cycle late"].max_s == pytest.approx(max(tick.late_s for tick in flying))


def test_the_story_is_in_order_and_names_what_was_done(frozen: Recorded) -> None:
    story = story_of(frozen.flown)
    assert [stretch.name for stretch in story.phases][-4:] == ["hold", "track", "handed over", "disarmed"]
    assert [reacted.reaction for reacted in story.reactions] == ["PX4 lands"]
    (stuck,) = (seen for seen in story.faults if seen.fault == story.reactions[0].cause)
    assert stuck.reaction == "PX4 lands"
    assert stuck.begin_s == pytest.approx(story.reactions[0].at_s)
    assert [(said.kind, said.text) for said in story.said] == [
        ("command", "takeoff <1.2 m>"), ("reply", "holds at 1.20 m"),
    ]  # fmt: skip
    assert story.ended == f"landed and disarmed: {story.reactions[0].reason}"


def test_a_flight_has_all_figures_of_the_paper(frozen: Recorded) -> None:
    charts = charts_of(frozen.flown, story_of(frozen.flown))
    assert {*DRAWN, "signals", "horizon", "thrust", "latencies"} == {chart.name for chart in charts}


@pytest.mark.parametrize("kind", ["pdf", "png"])
def test_figures_for_a_paper_are_a_column_wide(frozen: Recorded, tmp_path: Path, kind: str) -> None:
    chart = _chart(frozen.flown, "events")
    path = tmp_path / f"events.{kind}"
    chart.save(path, Medium.PAPER)
    if kind == "png":
        assert imread(path).shape[1] == 1050, "3.5 inches at 300 dots an inch"
    else:
        assert re.search(rb"/MediaBox \[ 0 0 252 ", path.read_bytes()), "points"


def _chart(flown: Flown, name: str) -> Chart:
    return next(chart for chart in charts_of(flown, story_of(flown)) if chart.name == name)


class _Refers(HTMLParser):
    """Collector of a page's external references and of its text."""

    def __init__(self) -> None:
        super().__init__()
        self.elsewhere: list[str] = []
        self.text = ""
        self.pictures = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.pictures += tag == "img"
        self.elsewhere += [f"{tag} {value}" for name, value in attrs if name in {"src", "href"} and value and not
                           value.startswith(("data:", "#"))]  # fmt: skip
        self.elsewhere += [tag] * (tag in {"script", "link", "iframe", "object"})

    def handle_data(self, data: str) -> None:
        self.text += data


def _page(path: Path) -> _Refers:
    page = _Refers()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def test_the_page_needs_nothing_else_and_says_it_all(frozen: Recorded, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    ran = CliRunner().invoke(app, ["report", str(frozen.path), "--out", str(out), "--json"])
    assert ran.exit_code == 0, ran.output
    page = _page(out)
    assert page.elsewhere == []
    assert "url(" not in out.read_text(encoding="utf-8")
    assert page.pictures == 14
    for said in ("PX4 lands", "takeoff <1.2 m>", "Errors (cm)", "etnn", "complete", "mocap frozen", "law = 1"):
        assert said in page.text
    (flight,) = json.loads(ran.stdout)["flights"]
    numbers = numbers_of(frozen.flown)
    assert numbers.tracked is not None
    assert flight["tracked"]["mean_m"] == list(numbers.tracked.mean_m)
    assert not flight["truncated"]


def test_a_record_that_was_cut_off_is_reported_and_said_to_be(frozen: Recorded, tmp_path: Path) -> None:
    whole = frozen.path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: 2 * len(whole) // 3])
    numbers = numbers_of(Flown(read_flight(cut)))
    assert numbers.truncated
    assert numbers.ended.startswith("not known: the record ends in phase")
    assert "cut off" in dict(head(numbers))["record"]
    assert numbers.whole is not None


def test_a_whole_file_of_half_a_flight_is_said_to_break_off(frozen: Recorded) -> None:
    """The service was killed, and its writer closed the file."""
    flying = frozen.flown.time_s < 5.0
    columns = {name: column[flying] for name, column in frozen.flown.record.columns.items()}
    numbers = numbers_of(Flown(replace(frozen.flown.record, columns=columns)))
    assert dict(head(numbers))["record"].startswith("breaks off in flight")
    assert dict(head(numbers_of(frozen.flown)))["record"] == "complete"


def test_laws_that_followed_each_other_are_told_in_order(frozen: Recorded) -> None:
    flown, names = frozen.flown, frozen.flown.record.columns["law_name"].copy()
    names[flown.time_s > 6.0] = "pid"
    both = Flown(replace(flown.record, columns=flown.record.columns | {"law_name": names}))
    numbers = numbers_of(both)
    assert numbers.laws == ("etnn", "pid")
    assert dict(head(numbers))["law"] == "etnn from 0.0 s, then pid from 6.0 s"
    (line,) = (chart for chart in charts_of(both, numbers.story) if chart.name == "timeline")
    written = {text.get_text() for axes in line.figure(Medium.PAGE).axes for text in axes.texts}
    assert {"etnn", "pid", "track", "PX4 lands", "mocap frozen → PX4 lands", "takeoff <1.2 m>"} <= written


@pytest.mark.parametrize("medium", Medium)
def test_words_on_the_time_line_neither_cover_each_other_nor_leave_it(frozen: Recorded, medium: Medium) -> None:
    end_s = float(frozen.flown.time_s[-1])
    verbs = ("arm", "takeoff height_m=1.0", "track curve=ellipse laps=1 period_s=15.0", "controller name=pid", "land")
    said = tuple(
        Said(float(at_s), "command", verb) for at_s, verb in zip(np.linspace(-2.0, end_s, 15), verbs * 3, strict=True)
    )
    story = replace(story_of(frozen.flown), said=said)
    (line,) = (chart for chart in charts_of(frozen.flown, story) if chart.name == "timeline")
    figure = line.figure(medium)
    figure.savefig(BytesIO())
    axes = figure.axes[-1]
    boxes = [text.get_window_extent() for text in axes.texts if text.get_text().split()[0] in "arm takeoff track land"]
    assert len(boxes) >= 5
    assert not [1 for one, other in combinations(boxes, 2) if one.overlaps(other)]
    faults = [text.get_window_extent() for text in axes.texts if "→" in text.get_text()]
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes + faults)


def test_missing_cycles_are_counted(frozen: Recorded, tmp_path: Path) -> None:
    columns = {name: np.delete(column, slice(700, 720), axis=0) for name, column in frozen.flown.record.columns.items()}
    numbers = numbers_of(Flown(replace(frozen.flown.record, columns=columns)))
    assert dict(head(numbers))["record"] == "20 cycles are missing"


def test_two_flights_are_compared_first(frozen: Recorded) -> None:
    numbers = numbers_of(frozen.flown)
    grid = comparison([numbers, replace(numbers, trajectories=())])
    assert [row[0].text for row in grid.rows] == ["A", "B"]
    assert [row[2].text for row in grid.rows] == ["trajectory", "flight"]
    assert numbers.whole is not None
    assert grid.rows[1][6].text == f"{100.0 * numbers.whole.mean_m[3]:.2f}"
    (compared,) = overlaid([frozen.flown, frozen.flown])
    axes = compared.figure(Medium.PAPER).axes
    assert [len(one.get_lines()) for one in axes] == [3] * 4  # both flights and zero


def test_a_flight_that_never_left_the_ground_has_a_page(frozen: Recorded) -> None:
    columns = frozen.flown.record.columns
    standing = ~columns["airborne"] & (np.arange(len(columns["time_s"])) < np.argmax(columns["airborne"]))
    on_ground = Flown(
        replace(frozen.flown.record, columns={name: c[standing] for name, c in columns.items()}, health=())
    )
    numbers = numbers_of(on_ground)
    assert error_table(numbers) is None
    assert numbers.duration_s == 0.0
    assert json.dumps(numbers.as_dict(), allow_nan=False)
    for chart in charts_of(on_ground, numbers.story):
        chart.figure(Medium.PAGE)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("nothing.mcap", None, "cannot be read"),
        ("note.mcap", b"hello", "no record of a flight"),
        ("empty.mcap", b"\x89MCAP0\r\n", "without a single tick"),
    ],
)
def test_what_is_no_record_is_refused_in_a_sentence(
    tmp_path: Path, name: str, content: bytes | None, says: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    ran = CliRunner().invoke(app, ["report", str(path)])
    assert isinstance(ran.exception, RecordError)
    assert re.search(says, str(ran.exception))
    assert not path.with_suffix(".html").exists()


def test_a_page_in_a_folder_that_is_not_there_is_refused(frozen: Recorded, tmp_path: Path) -> None:
    ran = CliRunner().invoke(app, ["report", str(frozen.path), "--out", str(tmp_path / "nosuch" / "page.html")])
    assert isinstance(ran.exception, ConfigError)
    assert "there is no folder" in str(ran.exception)
    assert not (tmp_path / "nosuch").exists()


def test_time_in_the_air_counts_the_landing_that_px4_flew(frozen: Recorded) -> None:
    numbers = numbers_of(frozen.flown)
    landed_s = next(tick.time_s for tick in reversed(frozen.flight.ticks) if tick.status.in_air)
    begun_s = next(tick.time_s for tick in frozen.flight.ticks if tick.flight.airborne)
    assert numbers.duration_s == pytest.approx(landed_s - begun_s, abs=0.1)
    assert numbers.duration_s > numbers.law_s + 3.0
    said = dict(head(numbers))["in the air"]
    assert said == f"{numbers.duration_s:.1f} s, {numbers.law_s:.1f} s of them by our law"


def test_no_curve_goes_on_where_nobody_knew_the_place_any_more(frozen: Recorded) -> None:
    flown = frozen.flown
    frozen_s = story_of(flown).reactions[0].at_s
    for name in ("timeline", "position"):
        axes = _chart(flown, name).figure(Medium.PAGE).axes[0]
        curves = [np.asarray(line.get_xydata()) for line in axes.get_lines()]
        last_s = [curve[np.isfinite(curve[:, 1]), 0][-1] for curve in curves if len(curve) > 2]
        assert max(last_s) < frozen_s + 1.0, "PX4 flies ten more seconds, and motion capture sees none of it"


def test_the_verdict_names_the_failsafe_and_its_cause(frozen: Recorded) -> None:
    numbers = numbers_of(frozen.flown)
    said = verdict(numbers)
    assert said.tone == BAD
    assert "Failsafe: PX4 lands at" in said.text
    assert "because of mocap frozen" in said.text
    assert len(summary(numbers)) == 2


def test_the_page_does_not_overwrite_a_flight(frozen: Recorded) -> None:
    ran = CliRunner().invoke(app, ["report", str(frozen.path), "--out", str(frozen.path)])
    assert isinstance(ran.exception, ConfigError)
