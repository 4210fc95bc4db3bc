"""Tests of the paths that a script may give: what is sent, and the sentence about what cannot be."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from companion.client.command_draft import CommandDraft
from companion.client.paths import Curve, fields_of_path, fields_of_position
from companion.config.trajectory_files import read_waypoints
from companion.core.errors import ConfigError
from companion.protocol.commands import COMMAND, Track

LINE = np.array([[0.0, 0.0, 0.0, 1.0, 0.0], [2.0, 1.0, 0.0, 1.0, 0.5]])


def sent(path: Any) -> Track:
    command = COMMAND.validate_json(CommandDraft("track", **fields_of_path(path)).payload("0" * 16, 0.0, "me"))
    assert isinstance(command, Track)
    return command


def test_a_curve_has_the_services_own_defaults() -> None:
    assert sent(Curve("figure8")).model_dump(exclude={"id"}) == sent("figure8").model_dump(exclude={"id"})
    lap = sent(Curve("ellipse", laps=1, period_s=8.0, size=0.5, height_m=1.2))
    assert (lap.curve, lap.laps, lap.period_s, lap.size, lap.height_m) == ("ellipse", 1, 8.0, 0.5, 1.2)


def test_a_file_and_the_array_with_its_rows_are_one_path(tmp_path: Path) -> None:
    file = tmp_path / "line.csv"
    np.savetxt(file, LINE, delimiter=",", header="t_s,x_m,y_m,z_m,yaw_rad", comments="")
    assert sent(file).waypoints == sent(str(file)).waypoints == sent(LINE).waypoints == sent(LINE.tolist()).waypoints
    assert np.array_equal(read_waypoints(file).positions_w_m, LINE[:, 1:4])


def test_without_headings_the_vehicle_keeps_to_zero() -> None:
    waypoints = sent(LINE[:, :4]).waypoints
    assert waypoints is not None
    assert [one.yaw_rad for one in waypoints] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("elipse", "unknown trajectory 'elipse': give ellipse or figure8, or a CSV file of waypoints"),
        (Path("no.csv"), "no.csv: there is no such file"),
        (LINE[:, :3], "track: give rows of t_s, x_m, y_m, z_m, and perhaps yaw_rad: .*, not one of shape (2, 3)"),
        (LINE[0], "track: give rows of t_s, x_m, y_m, z_m, and perhaps yaw_rad: .*, not one of shape (5,)"),
        ([[0.0, 1.0], [1.0]], "track: give rows of t_s, x_m, y_m, z_m"),
        ([["a"] * 4] * 2, "track: give rows of t_s, x_m, y_m, z_m"),
        (LINE[:1], "track: give 2 to 400 waypoints, not 1"),
        (np.tile(LINE, (201, 1)), "track: give 2 to 400 waypoints, not 402"),
        (LINE[::-1], "track: waypoint 0: t_s must begin at 0, not 2"),
        (LINE * [1, 1, 1, np.nan, 1], "track: waypoints.0.z_m = nan: must be a finite number"),
        (LINE * [1, 60, 1, 1, 1], "track: waypoints.1.x_m = 60.0: must be at most 50"),
        (LINE + np.array([0, 0, 0, 0, 180]), "track: waypoints.0.yaw_rad = 180.0: must be at most 6.3"),
    ],
)
def test_what_is_no_path_is_one_sentence(path: Any, sentence: str) -> None:
    with pytest.raises(ConfigError) as error:
        sent(path)
    begin, _, end = sentence.partition(".*")
    assert str(error.value).startswith(begin)
    assert end in str(error.value)
    assert "\n" not in str(error.value)


@given(arrays(float, (7, 4), elements=st.floats(-50.0, 50.0)))
def test_any_array_within_the_limits_arrives_as_it_was_to_a_micrometre(table: Any) -> None:
    table[:, 0] = np.arange(7) / 10.0
    waypoints = sent(table).waypoints
    assert waypoints is not None
    arrived = [(one.t_s, one.x_m, one.y_m, one.z_m) for one in waypoints]
    assert np.allclose(arrived, table, atol=5.1e-7, rtol=0.0)


@pytest.mark.parametrize("position", [(1.0, 2.0), (1.0, 2.0, 3.0, 4.0), "abc", 1.0, (1.0, 2.0, None)])
def test_a_position_that_is_not_three_numbers_is_one_sentence(position: Any) -> None:
    with pytest.raises(ConfigError, match="goto: the position must be three numbers x, y, z in m, not "):
        fields_of_position(position)


def test_a_position_may_be_an_array() -> None:
    assert fields_of_position(np.array([1, 2, 3])) == {"x_m": 1.0, "y_m": 2.0, "z_m": 3.0}
