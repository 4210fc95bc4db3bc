"""`companion experiments` as typed, on experiments of some seconds."""

import json
import re
from functools import wraps
from pathlib import Path

import pytest

from companion.cli.studies import experiments as command
from companion.studies.paper import campaign
from companion.studies.paper.campaign import Flown, Job
from tests.cli.typed import Type, typing
from tests.control.first_law import FAILING_LINE, failing_law
from tests.flights.command import ROOT
from tests.studies.short_experiments import short_experiment

pytestmark = pytest.mark.slow

PRACTICAL = ROOT / "config" / "controllers" / "practical.toml"


@pytest.fixture
def typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    """`companion experiments ARGUMENTS` in this process and a folder without results."""
    monkeypatch.chdir(tmp_path)
    return typing("experiments", monkeypatch, capsys)


@pytest.fixture
def short(tmp_path: Path) -> Path:
    return short_experiment(tmp_path / "short.toml")


def test_the_summary_has_every_law_and_is_the_same_for_the_same_seeds(typed: Type, short: Path, tmp_path: Path) -> None:
    """In one process and in two; byte for byte."""
    once, again = tmp_path / "once.json", tmp_path / "again.json"
    asked = ("--experiments", short, "--controllers", "practical", "--seeds", "4:5", "--no-report", "--no-ablations")
    first = typed(*asked, "--summary", once, "--jobs", "1")
    assert first.code == 0, first.err
    assert typed(*asked, "--summary", again, "--jobs", "2", "--fresh").code == 0
    assert once.read_bytes() == again.read_bytes()
    data = json.loads(once.read_text(encoding="utf-8"))
    assert (data["seeds"], data["bandwidth_radps"], data["complete"]) == ([4, 5], None, True)
    laws = data["experiments"]["short"]
    assert set(laws) == {"pid", "practical"}
    for numbers in laws.values():
        assert len(numbers["mean_error_m"]) == len(numbers["max_error_m"]) == 3
        assert all(
            0.0 < mean < most for mean, most in zip(numbers["mean_error_m"], numbers["max_error_m"], strict=True)
        )
    assert laws["pid"]["update_share"] == 1.0
    assert 0.0 < laws["practical"]["update_share"] < 0.5
    means = [laws[name]["mean_error_m"] for name in ("practical", "pid")]
    reduced = [100.0 * (1.0 - mine / other) for mine, other in zip(*means, strict=True)]
    assert laws["practical"]["mean_reduced_percent"] == pytest.approx(reduced)
    assert not list(tmp_path.rglob("report.html"))


def test_the_report_and_every_variant(typed: Type, short: Path, tmp_path: Path) -> None:
    out, summary = tmp_path / "out", tmp_path / "summary.json"
    asked = ("--experiments", short, "--controllers", "practical", "--seeds", "1:1", "--out", out, "--summary", summary)
    ended = typed(*asked, "--jobs", "1", "--bandwidth", "8")
    assert ended.code == 0, ended.err
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "--seeds 1:1 --bandwidth 8" in text
    assert "attitude loop of second order, 8, 8 and 3 rad/s" in text
    assert "without compensator" in text
    assert "law = &quot;pid&quot;" in text
    assert {path.name for path in out.iterdir()} >= {"report.html", "short-position.png", "short-position.pdf"}
    assert "short-position" not in text  # it is inside
    variants = json.loads(summary.read_text(encoding="utf-8"))["experiments"]["short"]["practical"]["variants"]
    assert {"without_network", "without_trigger"} <= set(variants)
    assert variants["without_trigger"]["event_share"] == 1.0


def test_a_law_outside_its_limits_is_a_bad_result(typed: Type, short: Path, tmp_path: Path) -> None:
    strict = tmp_path / "strict.toml"
    text = re.sub(r"mean_m = [0-9.]+", "mean_m = 0.0001", PRACTICAL.read_text(encoding="utf-8"))
    strict.write_text(text, encoding="utf-8")
    asked = ("--experiments", short, "--controllers", strict, "--seeds", "1:1", "--no-report", "--no-ablations")
    ended = typed(*asked, "--jobs", "1")
    assert ended.code == 1
    assert "strict on short: outside its error limits" in ended.out


def test_what_was_flown_before_an_interruption_is_kept_and_not_flown_again(
    typed: Type, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[str] = []

    @wraps(campaign.fly_job)
    def fly(job: Job) -> Flown:
        flown.append(job.item.controller)
        if flown == ["pid", "practical"]:
            raise KeyboardInterrupt
        return campaign.fly_job(job)

    monkeypatch.setattr(command, "fly_job", fly)
    summary = tmp_path / "summary.json"
    asked = ("--experiments", short, "--controllers", "practical", "--seeds", "1:1", "--no-report", "--no-ablations")
    ended = typed(*asked, "--summary", summary, "--jobs", "1")
    assert ended.code == 130
    assert "Traceback" not in ended.err
    assert "interrupted after 1 of 2 flights; the same command goes on" in ended.out
    data = json.loads(summary.read_text(encoding="utf-8"))
    assert data["complete"] is False
    assert list(data["experiments"]["short"]) == ["pid"]
    assert typed(*asked, "--summary", summary, "--jobs", "1").code == 0
    assert flown == ["pid", "practical", "practical"]
    assert json.loads(summary.read_text(encoding="utf-8"))["complete"] is True


def test_a_file_may_not_go_by_the_baselines_name_unless_it_is_the_baseline(
    typed: Type, short: Path, tmp_path: Path
) -> None:
    shipped, own, summary = ROOT / "config" / "controllers" / "pid.toml", tmp_path / "pid.toml", tmp_path / "s.json"
    own.write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8")
    asked = ("--experiments", short, "--seeds", "2", "--no-report", "--no-ablations", "--summary", summary)
    refused = typed(*asked, "--controllers", own)
    assert refused.code == 2
    assert (
        f"--controllers {own}: pid is the name of the baseline, which is always flown: rename the file" in refused.err
    )
    assert len(refused.err.strip().splitlines()) == 1
    flown = typed(*asked, "--controllers", shipped)
    assert flown.code == 0, flown.out + flown.err
    assert "reduced (%)" not in flown.out, "it stands there once"
    assert list(json.loads(summary.read_text(encoding="utf-8"))["experiments"]["short"]) == ["pid"]


def test_the_law_as_printed_stands_beside_the_others(typed: Type, short: Path, tmp_path: Path) -> None:
    """It is lost, and the table and the report can say so."""
    out, summary = tmp_path / "out", tmp_path / "s.json"
    asked = ("--experiments", short, "--controllers", "paper", "--seeds", "1", "--jobs", "1", "--no-ablations")
    ended = typed(*asked, "--allow-unstable", "--out", out, "--summary", summary)
    assert ended.code == 1, ended.err
    assert "paper on short: lost 1 of 1" in ended.out
    assert json.loads(summary.read_text(encoding="utf-8"))["experiments"]["short"]["paper"]["diverged"] == 1
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "--seeds 1:1 --allow-unstable" in text
    assert "paper, lost 1 of 1" in text
    assert "paper was lost and is left out" in text


def test_a_law_of_ones_own_that_raises_in_flight_is_one_sentence(typed: Type, short: Path, tmp_path: Path) -> None:
    """In another process as in this one."""
    toml = failing_law(tmp_path)
    asked = ("--experiments", short, "--controllers", toml, "--seeds", "1", "--no-ablations", "--no-report")
    for jobs in ("1", "2"):
        ended = typed(*asked, "--jobs", jobs)
        assert ended.code == 2
        assert f"{tmp_path / 'pd.py'}: raised in flight: KeyError: 'none' (line {FAILING_LINE})" in ended.err
        assert len(ended.err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--seeds", "5:1"),
            "--seeds 5:1: must be FIRST:LAST, two whole numbers from 0 on in this order, as in 1:5, or one seed",
        ),
        (("--seeds", "3:"), "--seeds 3:: must be FIRST:LAST"),
        (("--seeds", "-1:2"), "--seeds -1:2: must be FIRST:LAST"),
        (("--seeds", "0:1000"), "1001 seeds, at most 1000"),
        (("--experiments", "oval"), "unknown experiment 'oval': give a TOML file or one of ellipse, figure8"),
        (("--experiments", ","), "--experiments ',': give at least one name or TOML file"),
        (("--controllers", "nonesuch"), "unknown controller 'nonesuch': give a TOML file"),
        (("--controllers", "paper"), "the loop of command filter and compensation is unstable"),
        (("--controllers", f"practical,{PRACTICAL}"), "practical is given 2 times, give each name once"),
        (("--controllers", "pid", "--summary", "/proc/none/s.json"), "cannot write to /proc/none"),
        (("--controllers", "pid", "--summary", "."), "--summary . is a folder"),
        (("--controllers", "pid", "--summary", "/proc/s.json"), "cannot write to /proc/s.json"),
        (("--controllers", "pid", "--out", "/proc"), "cannot write to /proc"),
    ],
)
def test_refused_in_a_sentence(typed: Type, arguments: tuple[str, ...], sentence: str) -> None:
    ended = typed(*arguments)
    assert ended.code == 2
    assert sentence in ended.err
    assert "Traceback" not in ended.err
    assert len(ended.err.strip().splitlines()) == 1


def test_a_law_on_the_ground_over_a_radio(typed: Type, short: Path, tmp_path: Path) -> None:
    summary = tmp_path / "ground.json"
    asked = ("--experiments", short, "--controllers", "practical", "--seeds", "1:2", "--no-report", "--no-ablations")
    ended = typed(*asked, "--law-on", "ground", "--link", "loss 10% delay 2 ms", "--summary", summary, "--jobs", "1")
    assert ended.code == 0, ended.err
    data = json.loads(summary.read_text(encoding="utf-8"))
    assert (data["law_on"], data["link"]) == ("ground", "loss 10% delay 2 ms")
    laws = data["experiments"]["short"]
    assert laws["pid"]["link"]["messages_per_s"] > 95.0, "it has no trigger"
    assert laws["practical"]["link"]["messages_per_s"] < 50.0
    assert "practical: link " in ended.out
