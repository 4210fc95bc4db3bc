"""Trajectories by name or from a CSV file, and what is wrong with a file in one sentence."""

from pathlib import Path

import numpy as np
import pytest

from companion.config.trajectory_files import Curve, trajectory_named
from companion.core.interfaces import ConfigError
from companion.trajectories.reference import Ellipse, FigureEight
from companion.trajectories.waypoints import Waypoints

GOOD = "t_s,x_m,y_m,z_m\n0,0,0,1\n2,1,0,1.5\n4.5,0,1,1\n"


def written(folder: Path, text: str) -> str:
    path = folder / "way.csv"
    path.write_text(text, encoding="utf-8")
    return str(path)


def complaint(name: str) -> str:
    with pytest.raises(ConfigError) as caught:
        trajectory_named(name, Curve())
    assert "\n" not in str(caught.value), "one sentence"
    return str(caught.value)


def test_the_names_are_the_papers_two_curves() -> None:
    ellipse = trajectory_named("ellipse", Curve(laps=3, period_s=12.0, size=2.0, height_m=1.5))
    assert isinstance(ellipse, Ellipse)
    assert ellipse.semi_axes_m == (2.0, 1.2)
    assert ellipse.duration_s == 3 * 12.0 + 4.0
    assert ellipse.at(0.0).position_w_m[2] == 1.5
    eight = trajectory_named("figure8", Curve())
    assert isinstance(eight, FigureEight)
    assert eight.semi_axes_m == (1.0, 0.5)


def test_waypoints_are_read_from_a_csv_file(tmp_path: Path) -> None:
    way = trajectory_named(written(tmp_path, GOOD), Curve())
    assert isinstance(way, Waypoints)
    assert way.duration_s == 4.5
    np.testing.assert_allclose(way.at(2.0).position_w_m, [1.0, 0.0, 1.5], atol=1e-9)
    assert way.at(2.0).yaw_rad == 0.0, "without a column the heading stays"


def test_a_heading_column_is_optional_and_so_is_the_order(tmp_path: Path) -> None:
    text = "yaw_rad, t_s, z_m, y_m, x_m\n0.1,0,1,0,0\n0.4,2,1.5,0,1\n0,4,1,1,0\n"
    way = trajectory_named(written(tmp_path, text), Curve())
    np.testing.assert_allclose(way.at(2.0).position_w_m, [1.0, 0.0, 1.5], atol=1e-9)
    assert way.at(2.0).yaw_rad == pytest.approx(0.4)
    assert way.at(4.0).yaw_rad == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty; the first line must be t_s,x_m,y_m,z_m or"),
        ("a,b\n1,2\n", "the first line must be t_s,x_m,y_m,z_m or"),
        ("0,0,0,1\n2,1,0,1\n", "the first line must be t_s,x_m,y_m,z_m or"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n2,one,0,1\n", "line 3: every value must be a number"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n2,1\n", "line 3: 4 values are needed, there are 2"),
        ("t_s,x_m,y_m,z_m\n0,0,nan,1\n2,1,0,1\n", "line 2: every value must be finite"),
        ("t_s,x_m,y_m,z_m\n0,0,0,inf\n2,1,0,1\n", "line 2: every value must be finite"),
        ("t_s,x_m,y_m,z_m\n1,0,0,1\n2,1,0,1\n", "line 2: t_s must begin at 0, not 1"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n2,1,0,1\n2,1,1,1\n", "line 4: t_s must rise, 2 does not follow 2"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n0.001,1,0,1\n", "line 3: t_s must rise by at least 0.01 s, 0.001 follows 0"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n4000,1,0,1\n", "line 3: t_s must be at most 3600 s, not 4000"),
        (
            "t_s,x_m,y_m,z_m,yaw_rad\n0,0,0,1,0\n2,1,0,1,90\n",
            "line 3: yaw_rad = 90 is more than a whole turn (6.28): is it in degrees? Give radians",
        ),
        ("t_s,x_m,y_m,z_m,yaw_deg\n0,0,0,1,0\n2,1,0,1,0\n", "the first line must be t_s,x_m,y_m,z_m or"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n2,1,0,1,9\n", "line 3: 4 values are needed, there are 5"),
        ("t_s,x_m,y_m,z_m\n0,0,0,1\n", "at least two waypoints are needed, there are 1"),
        ("t_s,x_m,y_m,z_m\n", "at least two waypoints are needed, there are 0"),
    ],
)
def test_a_bad_file_is_one_sentence_that_names_it(tmp_path: Path, text: str, said: str) -> None:
    name = written(tmp_path, text)
    found = complaint(name)
    assert found.startswith(f"{name}: ")
    assert said in found


def test_a_file_that_is_not_there_or_is_no_text(tmp_path: Path) -> None:
    missing = str(tmp_path / "none.csv")
    assert complaint(missing) == f"{missing}: there is no such file"
    (tmp_path / "bytes.csv").write_bytes(b"t_s\xff\n")
    assert "the byte 0xff is no UTF-8" in complaint(str(tmp_path / "bytes.csv"))


def test_an_unknown_name_tells_the_known_ones() -> None:
    said = complaint("elipse")
    assert said == "unknown trajectory 'elipse': give ellipse or figure8, or a CSV file of waypoints"


def test_too_many_waypoints_are_refused_before_they_cost_minutes(tmp_path: Path) -> None:
    rows = "".join(f"{n},0,0,1\n" for n in range(401))
    assert "at most 400 waypoints, there are 401" in complaint(written(tmp_path, "t_s,x_m,y_m,z_m\n" + rows))
