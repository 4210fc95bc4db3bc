"""Dry runs of `companion arms`, and what is refused before any servo is asked; none of it has a bus."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread

from companion.arms.collision import clearance
from companion.arms.model import ArmModel
from companion.arms.trajectory import minimum_jerk
from companion.studies.paper.arm_motion import numbers_of
from tests.cli.arms_rig import ARMS
from tests.cli.typed import Type, typing
from tests.flights.command import ROOT

DEMO = ROOT / "config" / "demo.toml"


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    """`companion arms ARGUMENTS` in this process; its bus is a port that is not there."""
    return typing("arms", monkeypatch, capsys)


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def _motion(path: Path, *poses: str) -> Path:
    """Waypoints a second apart; each pose is three angles in degrees for both arms."""
    rows = (f"[[waypoints]]\nt_s = {t}.0\nright = [{pose}]\nleft = [{pose}]\n" for t, pose in enumerate(poses))
    return _write(path, 'kind = "waypoints"\nunit = "deg"\n' + "".join(rows))


def _row(out: str, joint: str) -> list[str]:
    return next(line for line in out.splitlines() if line.startswith(joint)).split()


@pytest.mark.parametrize(
    ("command", "begin", "end"),
    [
        (["home"], ARMS.stow_rad(), ARMS.home_rad()),
        (["stow", "--from", "home"], ARMS.home_rad(), ARMS.stow_rad()),
        (["grip", "open", "--from", "home"], ARMS.home_rad(), None),
        (["play", "swing"], ARMS.stow_rad(), None),
    ],
)
def test_a_dry_run_says_from_where_to_where_how_long_and_how_near(
    typed: Type, command: list[str], begin: np.ndarray, end: np.ndarray | None
) -> None:
    ran = typed(*command, "--dry-run", "--config", DEMO)
    assert ran.code == 0, ran.err
    assert re.search(rf"^{command[0]}.*: \d+\.\d s$", ran.out, re.MULTILINE), ran.out
    row = _row(ran.out, "left.elbow_pitch")
    assert float(row[1]) == pytest.approx(np.degrees(begin[5]), abs=0.06)
    if end is not None:
        assert float(row[2]) == pytest.approx(np.degrees(end[5]), abs=0.06)
    assert re.search(r"least clearance 0\.\d{3} m, .* s into it: .* \(0\.020 m is required\)", ran.out)


def test_a_name_in_square_brackets_is_printed_as_it_is_typed(typed: Type, tmp_path: Path) -> None:
    motion = _motion(tmp_path / "[bold] lift[2].toml", "20, 40, 0", "25, 45, 0")
    ran = typed("play", motion, "--dry-run", "--config", DEMO)
    assert ran.code == 0, ran.err
    assert f"play {motion}: " in ran.out


def test_an_interrupt_while_planning_says_that_nothing_was_moved(typed: Type, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.cli.arms.carry_out.preview", interrupted)
    ran = typed("home", "--dry-run", "--config", DEMO)
    assert (ran.code, ran.out, ran.err) == (130, "", "interrupted: nothing was moved\n")


def test_grip_opens_both_claws_and_moves_nothing_else(typed: Type) -> None:
    out = typed("grip", "open", "--dry-run", "--config", DEMO).out
    for side in ("right", "left"):
        assert float(_row(out, f"{side}.claw")[2]) == pytest.approx(np.degrees(ARMS.poses.claw_open_rad), abs=0.06)
        for joint in ("shoulder_pitch", "elbow_pitch", "elbow_roll"):
            row = _row(out, f"{side}.{joint}")
            assert row[1] == row[2]


def test_a_motion_beyond_the_limits_of_speed_is_slowed_down_and_says_so(typed: Type, tmp_path: Path) -> None:
    quick = _motion(tmp_path / "quick.toml", "20, 40, 0", "80, 40, 0", "-60, 90, 0")
    ran = typed("play", quick, "--dry-run", "--config", DEMO)
    assert ran.code == 0, ran.err
    assert "shoulder_pitch would turn at" in ran.out
    assert "slowed down 1." in ran.out
    fastest = float(_row(ran.out, "right.shoulder_pitch")[7])
    assert 2.9 < fastest <= 3.0


def test_repeating_plays_the_motion_again_from_its_end(typed: Type) -> None:
    def seconds(*more: str) -> float:
        found = re.search(
            r"^play tips: (\S+) s$", typed("play", "tips", "--dry-run", *more, "--config", DEMO).out, re.M
        )
        assert found
        return float(found[1])

    once, thrice = seconds(), seconds("--repeat", "3")
    assert thrice - once == pytest.approx(2 * 6.0, abs=0.15)


def test_a_swing_lasts_as_long_as_asked(typed: Type) -> None:
    out = typed("play", "swing", "--duration", "10", "--dry-run", "--from", "home", "--config", DEMO).out
    found = re.search(r"^play swing: (\S+) s$.*motion's start takes (\S+) s", out, re.M | re.S)
    assert found
    assert float(found[1]) - float(found[2]) == pytest.approx(10.0, abs=0.11)


def test_the_plan_can_be_drawn(typed: Type, tmp_path: Path) -> None:
    path = tmp_path / "swing.png"
    ran = typed("play", "swing", "--dry-run", "--plot", path, "--config", DEMO)
    assert ran.code == 0, ran.err
    assert f"plot {path}" in ran.out
    picture = imread(path)
    assert picture.shape[0] > 600
    assert picture.std() > 0.05  # not an empty page


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (["play", "waltz", "--dry-run"], "unknown arm motion 'waltz': give reach, swing, tips, or a file"),
        (["play", "nowhere.toml", "--dry-run"], "nowhere.toml: there is no such file"),
        (["play", "INWARD", "--dry-run"], "right forearm and left forearm would"),
        (["play", "FAR", "--dry-run"], "right.shoulder_pitch would be at 1.601 rad (91.7 deg), allowed is"),
        (["home", "--dry-run", "--floor-z", "-0.3"], "and the floor would touch"),
        (["play", "reach", "--duration", "9", "--dry-run"], "--duration is for sinusoids"),
        (["home", "--dry-run", "--plot", "nowhere/plan.png"], "--plot nowhere/plan.png: cannot be written"),
        (["home", "--from", "home", "--yes"], "--from is for --dry-run"),
        (["home"], "home moves the arms, and there is no terminal to ask at: add --yes"),
        (["ping", "--port", "nowhere"], "no serial port nowhere (arms.port): plug in"),
        (
            ["ping", "--port", "nowhere"],
            "start `python -m mock_autopilot --config config/mock.toml`",
        ),
        (["home", "--config", "BARE"], "has no table [arms], so this vehicle has no arms"),
        (["ping", "--config", "BARE"], "has no table [arms], so this vehicle has no arms"),
        (["ping", "--config", "BAUD"], "arms.baud = 42: "),
    ],
)
def test_a_mistake_is_one_sentence_and_code_2(typed: Type, tmp_path: Path, command: list[str], sentence: str) -> None:
    files = {
        "INWARD": _motion(tmp_path / "inward.toml", "0, 40, 0", "0, 0, -34"),
        "FAR": _motion(tmp_path / "far.toml", "20, 40, 0", "100, 40, 0"),
        "BARE": _write(tmp_path / "bare.toml", "[vehicle]\nmass_kg = 4.0\n"),
        "BAUD": _write(tmp_path / "baud.toml", "[arms]\nbaud = 42\n"),
    }
    given = ["--config", str(DEMO)] if "--config" not in command else []
    ran = typed(*(files.get(word, word) for word in command), *given)
    assert ran.code == 2, ran.out + ran.err
    assert sentence in ran.err
    assert len(ran.err.strip().splitlines()) == 1


def test_the_file_for_a_real_room_has_arms(typed: Type) -> None:
    ran = typed("home", "--dry-run")
    assert ran.code == 0, ran.err


def test_the_numbers_of_a_minimum_jerk_move_are_those_of_flash_and_hogan() -> None:
    begin, end, duration_s = ARMS.stow_rad(), ARMS.home_rad(), 2.0
    way = np.abs(end - begin)
    numbers = numbers_of(ArmModel(), minimum_jerk(begin, end, duration_s))
    assert numbers.duration_s == duration_s
    np.testing.assert_allclose(numbers.fastest_radps, 1.875 * way / duration_s, rtol=1e-3, atol=1e-12)
    peak = 10.0 / np.sqrt(3.0) * way / duration_s**2
    np.testing.assert_allclose(numbers.sharpest_radps2, peak, rtol=0.01, atol=1e-12)


_POSES = st.tuples(
    *[
        st.floats(low, high)
        for low, high in zip(*(bound.tolist() for bound in ArmModel().limit_arrays()[:2]), strict=True)
    ]
)


@given(_POSES, _POSES, st.floats(0.0, 1.0))
def test_no_moment_of_a_motion_is_beyond_its_numbers(
    begin: tuple[float, ...], end: tuple[float, ...], share: float
) -> None:
    model, motion = ArmModel(), minimum_jerk(np.array(begin), np.array(end), 2.0)
    numbers = numbers_of(model, motion)
    near, now = numbers.nearest, motion.at(2.0 * share)
    there = clearance(model, motion.at(near.time_s).position_rad)
    assert there.distance_m == pytest.approx(near.distance_m, abs=1e-9)
    assert (np.abs(now.velocity_radps) <= 1.01 * numbers.fastest_radps + 1e-9).all()
    assert (np.abs(now.acceleration_radps2) <= 1.01 * numbers.sharpest_radps2 + 1e-9).all()
    step_m = (
        0.5 * 2.0 / 48 * (0.37 * numbers.fastest_radps[[0, 1, 2, 4, 5, 6]].sum())
    )  # how far a tip gets between looks
    assert clearance(model, now.position_rad).distance_m >= near.distance_m - step_m - 1e-9
