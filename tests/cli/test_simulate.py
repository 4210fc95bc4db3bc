"""`companion simulate`: what it prints, writes and refuses."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from companion.analysis.summary import summarise
from companion.cli.studies import simulate
from companion.records.read import read_flight
from tests.cli.typed import Type, typing
from tests.control.first_law import FAILING_LINE, failing_law
from tests.flights.command import ROOT

pytestmark = pytest.mark.slow

SHORT = """
title = "a short one"
settle_s = 1.0
arms = "{arms}"

[trajectory]
curve = "figure8"
semi_axes_m = [0.4, 0.2]
period_s = 6.0
laps = 1
ramp_s = 2.0

[companion.arms]

[mock.arms]
enabled = true

[mock.disturbance]
constant_ned_n = [0.4, -0.3, 0.2]
"""


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    """`companion simulate ARGUMENTS` in this process."""
    return typing("simulate", monkeypatch, capsys)


def short(folder: Path, arms: str = "off") -> Path:
    path = folder / "short.toml"
    path.write_text(SHORT.format(arms=arms), encoding="utf-8")
    return path


def read(path: Path) -> dict[str, Any]:
    """A summary, without the computer's speed."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    assert data.pop("times_real_time") > 0.0
    return data


def test_a_flight_is_reported_drawn_and_recorded(typed: Type, tmp_path: Path) -> None:
    ran = typed(short(tmp_path, "swing"), "--out", tmp_path / "out", "--summary", tmp_path / "numbers" / "s.json")
    assert ran.code == 0, ran.out + ran.err
    assert "tracking error, short, etnn, seed 1" in ran.out
    assert re.search(r"^ ?cm +x +y +z +limit$", ran.out, re.MULTILINE)
    assert re.search(r"^ ?mean +\d+\.\d\d +\d+\.\d\d", ran.out, re.MULTILINE)
    assert "times faster than real time" in ran.out
    assert "inside the error limits" in ran.out
    data = read(tmp_path / "numbers" / "s.json")
    columns = read_flight(tmp_path / "out" / "virtual-short-etnn-seed1.npz").columns
    summed_up = summarise(columns)
    assert summed_up is not None
    assert data["mean_error_m"] == pytest.approx(summed_up.mean_error_m)
    assert data["max_error_m"] == pytest.approx(summed_up.max_error_m)
    assert data["update_share"] == summed_up.update_share
    assert data["control_cycles"] == summed_up.control_cycles
    assert data["error_m"] == pytest.approx(np.linalg.norm(data["mean_error_m"]))
    assert (data["experiment"], data["controller"], data["diverged"]) == ("short", "etnn", 0)
    assert {"law_y1", "law_iota1", "law_f_hat", "law_kappa"} <= set(columns)
    assert np.degrees(np.ptp(columns["joint_position_rad"], axis=0)).max() > 5.0, "the joints' true angles"
    assert imread(tmp_path / "out" / "virtual-short-etnn-seed1.png").std() > 0.05


def test_several_seeds_fly_side_by_side_and_are_averaged(typed: Type, tmp_path: Path) -> None:
    experiment, together, alone = short(tmp_path), tmp_path / "all.json", tmp_path / "one.json"
    assert typed(experiment, "--seeds", "3:4", "--out", tmp_path / "out", "--summary", together).code == 0
    assert typed(experiment, "--seed", "4", "--summary", alone).code == 0
    batch, one = read(together), read(alone)
    assert [flight["seed"] for flight in batch["flights"]] == [3, 4]
    assert batch["flights"][1]["mean_error_m"] == pytest.approx(one["mean_error_m"], rel=0.05)
    for key in ("mean_error_m", "max_error_m", "update_share", "error_m"):
        assert batch[key] == pytest.approx(np.mean([flight[key] for flight in batch["flights"]], axis=0))
    assert len(list((tmp_path / "out").glob("virtual-short-etnn-seed[34].*"))) == 4


def test_the_same_seed_gives_the_same_numbers(typed: Type, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert typed(short(tmp_path), "--seed", "9", "--summary", tmp_path / name).code == 0
    assert read(tmp_path / "a") == read(tmp_path / "b")


def test_the_law_as_printed_is_refused_and_diverges_when_it_is_not(typed: Type, tmp_path: Path) -> None:
    refused = typed(short(tmp_path), "--controller", "paper")
    assert refused.code == 2
    assert "is unstable" in refused.err
    summary = tmp_path / "s.json"
    flown = typed("--controller", "paper", "--allow-unstable", "--summary", summary)
    assert flown.code == 1, flown.out + flown.err
    assert "diverged: more than 2 m from the reference" in flown.out
    assert read(summary)["diverged"] == 1
    assert not read(summary)["inside_limits"]


def test_a_flight_outside_its_limits_is_not_good(typed: Type, tmp_path: Path) -> None:
    strict = tmp_path / "strict.toml"
    text = (ROOT / "config" / "controllers" / "pid.toml").read_text(encoding="utf-8").split("[error_limits]")[0]
    strict.write_text(f"{text}\n[error_limits]\nmean_m = 0.001\nmax_m = 0.002\n", encoding="utf-8")
    ran = typed(short(tmp_path), "--controller", strict)
    assert ran.code == 1
    assert "outside the error limits" in ran.out


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        (("--ablate", "trigger"), {"update_share": 1.0}),
        (("--controller", "pid"), {"controller": "pid"}),
        (("--feedforward", "off"), {}),
        (("--bandwidth", "6.3"), {}),
    ],
)
def test_options_change_the_flight(typed: Type, tmp_path: Path, options: tuple[str], changed: dict[str, Any]) -> None:
    experiment = short(tmp_path, "swing")
    typed(experiment, "--summary", tmp_path / "as_it_is")
    assert typed(experiment, *options, "--summary", tmp_path / "otherwise").code == 0
    before, after = read(tmp_path / "as_it_is"), read(tmp_path / "otherwise")
    assert before["mean_error_m"] != after["mean_error_m"]
    assert {key: after[key] for key in changed} == changed


def test_the_demo_without_its_sockets(typed: Type, tmp_path: Path) -> None:
    summary = tmp_path / "s.json"
    ran = typed(
        "--demo", "--trajectory", "figure8", "--laps", "1", "--period", "8", "--arms", "off", "--summary", summary
    )
    assert ran.code == 0, ran.out + ran.err
    assert read(summary)["experiment"] == "demo-figure8"
    assert read(summary)["control_cycles"] == 1200


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("oval",), "unknown experiment 'oval'"),
        (("--laps", "3"), "--laps is only for --demo: an experiment's file defines its flight"),
        (("--mock-config", "x.toml"), "--mock-config is only for --demo"),
        (("ellipse", "--demo"), "ellipse: an experiment or --demo, not both"),
        (("--seed", "3", "--seeds", "1:2"), "--seed and --seeds: give one of them"),
        (("--seeds", "5:"), "--seeds 5:: must be FIRST:LAST"),
        (("--seeds", "5:1"), "--seeds 5:1: must be FIRST:LAST"),
        (("--seeds", "-1:4"), "--seeds -1:4: must be FIRST:LAST"),
        (("--controller", "none"), "unknown controller 'none'"),
        (("--controller", "pid", "--ablate", "network"), "law = 'pid': must be 'etnn' here"),
        (("--demo", "--size", "3", "--period", "4"), "ellipse: too fast"),
        (("--demo", "--trajectory", "square"), "unknown trajectory 'square'"),
        (("--demo", "--arms", "wave"), "unknown arm motion 'wave'"),
        (("--demo", "--config", "nowhere.toml"), "nowhere.toml: there is no such file"),
        (("--demo", "--mock-config", "nowhere.toml"), "cannot read nowhere.toml"),
        (("--summary", "config"), "--summary config is a folder: give the name of a file"),
        (("--out", "README.md"), "cannot write to README.md: File exists"),
        (("--out", "/proc"), "cannot write to /proc: "),
        (("--summary", "/proc/x.json"), "cannot write to /proc/x.json: "),
    ],
)
def test_what_cannot_be_flown_is_one_sentence(typed: Type, arguments: tuple[str, ...], said: str) -> None:
    ran = typed(*arguments)
    assert ran.code == 2, ran.out + ran.err
    assert said in ran.err
    assert ran.err.count("\n") == 1
    assert "Traceback" not in ran.out + ran.err


def test_a_law_of_ones_own_that_raises_in_flight_is_one_sentence(typed: Type, tmp_path: Path) -> None:
    ran = typed(short(tmp_path), "--controller", failing_law(tmp_path))
    assert ran.code == 2
    assert f"{tmp_path / 'pd.py'}: raised in flight: KeyError: 'none' (line {FAILING_LINE})" in ran.err
    assert ran.err.count("\n") == 1


def test_a_file_that_turns_out_not_to_be_writable_is_one_sentence(
    typed: Type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fail while the flights are written, as on a disk that has become full."""
    monkeypatch.setattr(simulate, "keep_flights", lambda *_: (tmp_path / "gone" / "x.png").write_bytes(b""))
    ran = typed(short(tmp_path), "--out", tmp_path / "out")
    assert ran.code == 2
    assert ran.err == f"companion: {tmp_path / 'gone' / 'x.png'}: No such file or directory\n"


def test_ctrl_c_ends_in_order(typed: Type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(simulate, "fly", interrupted)
    ran = typed(short(tmp_path), "--summary", tmp_path / "s.json")
    assert ran.code == 130
    assert "interrupted: nothing was written" in ran.out
    assert not (tmp_path / "s.json").exists()


def test_a_law_on_the_ground_has_the_links_numbers(typed: Type, tmp_path: Path) -> None:
    summary = tmp_path / "ground.json"
    asked = (short(tmp_path), "--law-on", "ground", "--link", "loss 10% jitter 20 ms", "--seeds", "1:2")
    ended = typed(*asked, "--summary", summary, "--out", tmp_path)
    assert ended.code == 0, ended.err
    link = read(summary)["link"]
    assert set(link) == {
        *("uplink_bytes_per_s", "messages_per_s", "events", "beats", "again", "lost", "age_ms"),
        *("longest_silence_ms", "landed_by_px4", "landed_s"),
    }
    assert 800.0 < link["uplink_bytes_per_s"] < 1300.0
    assert f"link {link['messages_per_s']:.0f} messages/s, {link['uplink_bytes_per_s']:.0f} bytes/s up" in ended.out


def test_a_flight_that_px4_ends_is_outside_its_limits(typed: Type, tmp_path: Path) -> None:
    summary = tmp_path / "off.json"
    ended = typed(short(tmp_path), "--law-on", "ground", "--link", "off", "--summary", summary)
    assert ended.code == 1
    assert "landed by PX4: 1 of 1" in ended.out
    numbers = read(summary)
    assert (numbers["inside_limits"], numbers["error_m"], numbers["link"]["landed_by_px4"]) == (False, None, 1)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--link", "loss 10%"], "--link 'loss 10%': there is no such link with the law on board"),
        (["--law-on", "ground", "--link", "loss of hope"], "--link 'loss of hope': "),
    ],
)
def test_a_link_that_cannot_be_is_refused(typed: Type, arguments: list[str], why: str) -> None:
    refused = typed(*arguments)
    assert refused.code == 2
    assert why in refused.err
