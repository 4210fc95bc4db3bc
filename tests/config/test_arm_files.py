"""Motions of the arms in files: what they mean, and one clear sentence for every mistake."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.arms.kinematics import tips_flu_m
from companion.arms.model import JOINT_NAMES, ArmModel
from companion.arms.planning import plan
from companion.arms.trajectory import JointTrajectory, at_rest
from companion.config.arm_files import motion_named
from companion.config.arms_config import PosesConfig
from companion.core.interfaces import ArmError, ConfigError
from companion.core.types import Array

MODEL = ArmModel()
PRESENT = np.linspace(0.1, 0.8, 8)
STOW = np.array([*PosesConfig().stow_rad, 0.05] * 2)
WAYPOINTS = 'kind = "waypoints"\nunit = "deg"\n'
SINUSOID = 'kind = "sinusoid"\nunit = "deg"\nduration_s = 10.0\n'
TIPS = 'kind = "tips"\nunit = "m"\n'


def written(folder: Path, text: str | bytes, name: str = "motion.toml") -> str:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(path)


def read(folder: Path, text: str, name: str = "motion.toml", duration_s: float | None = None) -> JointTrajectory:
    return motion_named(written(folder, text, name), duration_s).trajectory(MODEL, PRESENT)


def poses(motion: JointTrajectory, *times_s: float) -> Array:
    return motion.at(np.array(times_s)).position_rad


def complaint(folder: Path, text: str | bytes, name: str = "motion.toml") -> str:
    path = written(folder, text, name)
    with pytest.raises(ConfigError) as caught:
        motion_named(path)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value).replace(f"{path}: ", "")


def test_waypoints_in_degrees_are_met_and_what_is_left_out_stays(tmp_path: Path) -> None:
    text = WAYPOINTS + (
        "[[waypoints]]\nt_s = 0\nright = [10, 20, 5, 30]\n"
        "[[waypoints]]\nt_s = 1.5\nleft = [30.0, 40.0, -5.0]\n"
        "[[waypoints]]\nt_s = 2.5\nright = [0, 10, 0]\n"
    )
    right, later = np.radians([10.0, 20.0, 5.0, 30.0]), np.radians([30.0, 40.0, -5.0])
    found = poses(read(tmp_path, text), 0.0, 1.5, 2.5)
    np.testing.assert_allclose(found[0], [*right, *PRESENT[4:]])
    np.testing.assert_allclose(found[1], [*right, *later, PRESENT[7]])
    np.testing.assert_allclose(found[2], [0.0, math.radians(10.0), 0.0, right[3], *later, PRESENT[7]], atol=1e-12)


def test_radians_are_taken_as_they_are(tmp_path: Path) -> None:
    text = WAYPOINTS.replace("deg", "rad") + "waypoints = [{t_s = 0, left = [0.1, 0.2, 0.3]}, {t_s = 1}]"
    np.testing.assert_allclose(poses(read(tmp_path, text), 0.0)[0, 4:7], [0.1, 0.2, 0.3])


def test_waypoints_rest_at_each_point_unless_they_are_to_be_passed(tmp_path: Path) -> None:
    points = "waypoints = [{t_s = 0, left = [0, 0, 0]}, {t_s = 1, left = [10, 0, 0]}, {t_s = 2, left = [20, 0, 0]}]\n"
    stopping, passing = read(tmp_path, WAYPOINTS + points), read(tmp_path, WAYPOINTS + "stop = false\n" + points)
    assert stopping.at(1.0).velocity_radps[4] == pytest.approx(0.0, abs=1e-12)
    assert passing.at(1.0).velocity_radps[4] == pytest.approx(math.radians(10.0))


def test_a_sinusoid_swings_one_arm_about_its_centre_and_leaves_the_other(tmp_path: Path) -> None:
    text = (
        SINUSOID
        + "fade_s = 1.0\n[left]\ncentre = [10, 20, 0]\namplitude = [20, 0, 5]\nperiod_s = 4\nphase = [0, 0, 90]\n"
    )
    motion = read(tmp_path, text)
    assert motion.duration_s == 10.0
    # a quarter of a swing after a whole one: the shoulder at its highest, the roll, a quarter ahead, in its middle
    np.testing.assert_allclose(
        poses(motion, 5.0)[0], [*PRESENT[:4], *np.radians([30.0, 20.0, 0.0]), PRESENT[7]], atol=1e-9
    )


def test_a_sinusoid_goes_on_for_as_long_as_the_caller_wants(tmp_path: Path) -> None:
    text = SINUSOID + "[right]\ncentre = [10, 20, 0]\namplitude = [20, 0, 5]\nperiod_s = 4\n"
    assert read(tmp_path, text, duration_s=95.0).duration_s == 95.0


def test_tips_are_brought_to_their_points_and_an_arm_left_out_stays(tmp_path: Path) -> None:
    text = TIPS + (
        "[[tips]]\nt_s = 0\nleft = [0.25, 0.13, -0.25]\n"
        "[[tips]]\nt_s = 1\nright = [0.2, -0.2, -0.3]\nleft = [0.3, 0.1, -0.2]\n"
    )
    found = poses(read(tmp_path, text), 0.0, 1.0)
    np.testing.assert_allclose(found[0, :4], PRESENT[:4])
    np.testing.assert_allclose(tips_flu_m(MODEL, found[0])[1], [0.25, 0.13, -0.25], atol=1e-9)
    np.testing.assert_allclose(tips_flu_m(MODEL, found[1]), [[0.2, -0.2, -0.3], [0.3, 0.1, -0.2]], atol=1e-9)


def test_a_tip_out_of_reach_is_refused_with_its_time(tmp_path: Path) -> None:
    text = TIPS + "tips = [{t_s = 0, left = [0.25, 0.13, -0.25]}, {t_s = 1.5, left = [0.9, 0.13, -0.25]}]"
    with pytest.raises(ArmError, match=r"^at t_s = 1\.5: the left tip's target \(0\.900, .* is out of reach"):
        read(tmp_path, text)


def test_csv_says_joints_and_units_in_its_header(tmp_path: Path) -> None:
    text = "right.elbow_pitch_deg, t_s ,left.claw_rad\n10,0,0.5\n\n20,1,0.6\n30,2,0.7\n"
    motion = read(tmp_path, text, "motion.csv")
    found = poses(motion, 0.0, 1.0, 2.0)
    np.testing.assert_allclose(found[:, 1], np.radians([10.0, 20.0, 30.0]))
    np.testing.assert_allclose(found[:, 7], [0.5, 0.6, 0.7])
    np.testing.assert_allclose(found[:, [0, 2, 3, 4, 5, 6]], np.tile(PRESENT[[0, 2, 3, 4, 5, 6]], (3, 1)))
    assert motion.at(1.0).velocity_radps[1] == pytest.approx(math.radians(10.0))


def test_a_densely_recorded_csv_is_followed_closely(tmp_path: Path) -> None:
    times = np.arange(0.0, 8.0001, 0.02)
    angles = 30.0 - 20.0 * np.cos(times * math.pi / 4.0)
    rows = "".join(f"{t:.3f},{angle:.9f}\n" for t, angle in zip(times, angles, strict=True))
    motion = read(tmp_path, "t_s,left.shoulder_pitch_deg\n" + rows, "motion.csv")
    between = np.linspace(0.5, 7.5, 701)
    found = motion.at(between)
    np.testing.assert_allclose(
        found.position_rad[:, 4], np.radians(30.0 - 20.0 * np.cos(between * math.pi / 4)), atol=1e-6
    )
    np.testing.assert_allclose(
        found.acceleration_radps2[:, 4],
        np.radians(20.0) * (math.pi / 4) ** 2 * np.cos(between * math.pi / 4),
        atol=1e-3,
    )


@pytest.mark.parametrize("name", ["swing", "reach", "tips"])
def test_the_motions_that_come_with_the_project_run_at_their_own_speed_from_the_stowed_pose(name: str) -> None:
    made = plan(MODEL, motion_named(name).trajectory(MODEL, STOW), STOW)
    assert made.slowed_by == 1.0
    np.testing.assert_allclose(made.trajectory.at(0.0).position_rad, at_rest(STOW).position_rad)


def test_the_demos_swing_moves_shoulders_and_elbows_of_both_arms_by_25_degrees_to_each_side() -> None:
    motion = motion_named("swing", 60.0).trajectory(MODEL, STOW)
    span = np.ptp(motion.at(np.linspace(4.0, 56.0, 2000)).position_rad, axis=0)
    np.testing.assert_allclose(span[[0, 1, 4, 5]], math.radians(50.0), rtol=1e-3)
    assert motion.duration_s == 60.0


def test_a_csv_as_large_as_allowed_is_planned_without_a_long_wait(tmp_path: Path) -> None:
    rows = "".join(f"{0.03 * n:.3f},{20.0 + 5.0 * math.sin(0.03 * n):.6f}\n" for n in range(2000))
    motion = read(tmp_path, "t_s,left.shoulder_pitch_deg\n" + rows, "motion.csv")
    made = plan(MODEL, motion, np.array([*PosesConfig().home_rad, 0.3] * 2))
    assert made.trajectory.duration_s >= 59.97


def test_an_unknown_name_tells_the_known_ones() -> None:
    with pytest.raises(ConfigError) as caught:
        motion_named("swng")
    assert str(caught.value) == (
        "unknown arm motion 'swng': give reach, swing, tips, or a file that ends in .toml or .csv"
    )


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    for name in ("none.toml", "none.csv"):
        path = tmp_path / name
        with pytest.raises(ConfigError) as caught:
            motion_named(str(path))
        assert str(caught.value) == f"{path}: there is no such file"


def test_a_huge_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    said = complaint(tmp_path, b"x" * 1_200_000)
    assert said == "is larger than 1 MB, which is too much for such a file"


def test_a_folder_is_no_motion(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(ConfigError, match=r"folder\.toml: is a folder"):
        motion_named(str(tmp_path / "folder.toml"))


TWO = "waypoints = [{t_s = 0, left = [1, 2, 3]}, {t_s = 1}]\n"
ARM = "[right]\ncentre = [1, 2, 3]\namplitude = [1, 2, 3]\nperiod_s = 4.0\n"
MISTAKES = {
    "": "kind: is missing; give waypoints, sinusoid or tips",
    'kind = "wave"': "kind = 'wave': must be waypoints, sinusoid or tips",
    'kind = "waypoints"\n' + TWO: "unit: is missing",
    WAYPOINTS.replace("deg", "grad") + TWO: "unit = 'grad': must be 'deg' or 'rad'",
    WAYPOINTS: "waypoints: is missing",
    WAYPOINTS + "waypoints = []": "waypoints: 2 to 2000 are needed, there are 0",
    WAYPOINTS + "waypoints = 3": "waypoints = 3: must be a list of values",
    WAYPOINTS + TWO.replace("[1, 2, 3]", "[1, 2]"): (
        "waypoints.0.left = [1, 2]: must be three angles (shoulder pitch, elbow pitch, elbow roll) or four (the claw)"
    ),
    WAYPOINTS + TWO.replace("3", "nan"): "waypoints.0.left.2 = nan: must be a finite number",
    WAYPOINTS + TWO.replace("3", '"3"'): "waypoints.0.left.2 = '3': must be a number, without quotes",
    WAYPOINTS + TWO.replace("t_s = 1", "t_s = 0"): "waypoints.1.t_s = 0: must be at least 0.01 s after 0",
    WAYPOINTS + TWO.replace("t_s = 0", "t_s = 0.5"): "waypoints.0.t_s = 0.5: must be 0",
    WAYPOINTS + TWO.replace("t_s = 1", "t_s = 1e9"): ("waypoints.1.t_s = 1000000000.0: must be at most 600"),
    WAYPOINTS + TWO.replace("left", "lft"): "waypoints.0.lft: unknown key",
    WAYPOINTS + "sped = 1\n" + TWO: "sped: unknown key; known here are kind, stop, unit, waypoints",
    SINUSOID: "a sinusoid needs a table [right] or [left], or both",
    SINUSOID + ARM.replace("4.0", "0.0"): "right.period_s = 0.0: must be at least 0.2",
    SINUSOID + ARM.replace("centre", "center"): "right.centre: is missing\nright.center: unknown key",
    TIPS.replace('"m"', '"mm"') + "tips = [{t_s = 0}, {t_s = 1}]": "unit = 'mm': must be 'm'",
    TIPS + "tips = [{t_s = 0, left = [1, 2]}, {t_s = 1}]": (
        "tips.0.left = [1, 2]: must be three coordinates (x forward, y left, z up)"
    ),
    'kind = "way': "not valid TOML: Unterminated string (at end of document)",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_each_mistake_in_a_toml_file_gets_its_sentence(tmp_path: Path, text: str) -> None:
    assert complaint(tmp_path, text).startswith(MISTAKES[text])


HEADER = "t_s,right.claw_deg\n"
CSV_MISTAKES = {
    "": "is empty; the first line must be t_s,right.shoulder_pitch_deg,... (or _rad)",
    "right.claw_deg\n0\n": "the first line must be t_s,right.shoulder_pitch_deg,... (or _rad); it is 'right.claw_deg'",
    "t_s\n0\n1\n": "the first line must name t_s and at least one joint, as right.shoulder_pitch_deg",
    "t_s,right.claw\n0,1\n1,1\n": "column 'right.claw' must say its unit: right.claw_deg or right.claw_rad",
    "t_s,right.clew_deg\n0,1\n1,1\n": (
        f"unknown column 'right.clew_deg'; known are t_s and, followed by _deg or _rad, {', '.join(JOINT_NAMES)}"
    ),
    "t_s,right.claw_deg,right.claw_rad\n0,1,1\n1,1,1\n": "right.claw has two columns",
    HEADER + "0,1\n": "2 to 2000 waypoints are needed, there are 1",
    HEADER + "0,1\n1\n": "line 3: 2 values are needed, there are 1",
    HEADER + "0,1\n\n1,x\n": "line 4: every value must be a number, not '1,x'",
    HEADER + "0,1\n1,inf\n": "line 3: every value must be finite, not '1,inf'",
    HEADER + "1,1\n2,1\n": "line 2: t_s must begin at 0, not 1",
    HEADER + "0,1\n2,1\n1,1\n": "line 4: t_s must rise, 1 does not follow 2",
    HEADER + "0,1\n900,1\n": "line 3: t_s must be at most 600 s, not 900",
}


@pytest.mark.parametrize("text", CSV_MISTAKES)
def test_each_mistake_in_a_csv_file_gets_its_sentence(tmp_path: Path, text: str) -> None:
    assert complaint(tmp_path, text, "motion.csv") == CSV_MISTAKES[text]


def test_a_motion_may_come_from_a_spreadsheet(tmp_path: Path) -> None:
    text = "\ufeff" + "T_s;Right.claw_deg;;\r\n\r\n0;0,5;;\r\n2;45;;\r\n;;;\r\n"
    motion = read(tmp_path, text, "motion.csv")
    assert motion.duration_s == 2.0
    assert motion.at(0.0).position_rad[3] == pytest.approx(math.radians(0.5))


@pytest.mark.parametrize("name", ["motion.toml", "motion.csv"])
def test_a_file_that_is_not_utf_8_is_told(tmp_path: Path, name: str) -> None:
    assert "line 1: the byte 0xff is no UTF-8: save it as UTF-8" in complaint(tmp_path, b"t_s\xff\n", name)
