"""The mock's configuration, and the messages for wrong ones."""

from pathlib import Path

import pytest

from mock_autopilot.config import MockConfig, MockConfigError
from mock_autopilot.px4.params import INT32, ParamTable, UnknownParamError

DEMO = Path(__file__).parents[2] / "config" / "mock.toml"


def test_the_demo_vehicle_is_the_papers_without_gps() -> None:
    config = MockConfig.load(DEMO)
    assert config.plant.mass_kg == 4.85
    assert config.px4.params["EKF2_GPS_CTRL"] == 0
    assert len(config.disturbance.sinusoids) == 3
    assert config.qualisys.body == "dauam"


def test_without_a_file_it_is_a_stock_px4_with_gps() -> None:
    assert not MockConfig().px4.params
    assert ParamTable()["EKF2_GPS_CTRL"] == 7


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[plant]\nmas_kg = 1.0\n", "plant: unknown key mas_kg"),
        ("[vehicle]\nyaw = 1.0\n", "vehicle.yaw: unknown key"),
        ("[px4.params]\nNO_SUCH = 1\n", "PX4 has no parameter NO_SUCH"),
        ("[px4.params]\nCOM_OBL_RC_ACT = 1.5\n", "parameter COM_OBL_RC_ACT is a whole number"),
        ("[mavlink]\nremote_port = 0\n", "mavlink.remote_port"),
        ("[[disturbance.sinusoids]]\namplitude_ned_n = [1, 0, 0]\nperiod_s = 0\n", "a period_s must be greater than 0"),
        ("[plant\n", "is not valid TOML"),
        ("[plant]\nmass_kg = 0\n", "plant: mass_kg = 0.0: must be above 0"),
        ("[plant]\nmass_kg = nan\n", "plant.mass_kg = nan: must be a finite number"),
        ('[plant]\nmass_kg = "x"\n', "plant.mass_kg = 'x': must be a number"),
        ("[plant]\nviscous_npm = [1, -1, 1]\n", "plant: viscous_npm = (1.0, -1.0, 1.0): must not be negative"),
        ("[plant]\nviscous_npm = [1, 1]\n", "plant.viscous_npm = [1, 1]: 2 values are too few"),
        ("[arms.bodies]\nlink_mass_kg = [-1, 0, 0]\n", "link_mass_kg = (-1.0, 0.0, 0.0): must not be negative"),
        (
            "[disturbance]\nconstant_ned_n = [inf, 0, 0]\n",
            "disturbance.constant_ned_n.0 = inf: must be a finite number",
        ),
        ("[qualisys]\nrate_hz = 0\n", "qualisys.rate_hz = 0: must be above 0"),
        ('[qualisys]\nport = "abc"\n', "qualisys.port = 'abc': must be a whole number"),
        ("mavlink = 3\n", "mavlink = 3: must be a table"),
    ],
)
def test_a_wrong_file_is_answered_in_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mock.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MockConfigError) as error:
        MockConfig.load(path)
    assert said in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_from_a_windows_editor_is_read_and_utf_16_is_named(tmp_path: Path) -> None:
    path, text = tmp_path / "mock.toml", "[plant]\r\nmass_kg = 5.5\r\n"
    path.write_text(text, encoding="utf-8-sig")
    assert MockConfig.load(path).plant.mass_kg == 5.5
    path.write_text(text, encoding="utf-16")
    with pytest.raises(MockConfigError, match=r"mock\.toml is UTF-16 or no text at all: save it as UTF-8"):
        MockConfig.load(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MockConfigError, match=r"cannot read .*nowhere\.toml: No such file"):
        MockConfig.load(tmp_path / "nowhere.toml")


def test_parameters_know_their_place_and_type() -> None:
    table = ParamTable({"COM_OBL_RC_ACT": 4})
    param = table.find("COM_OBL_RC_ACT")
    assert param is not None
    assert (param.type, param.value, param.wire_bytes) == (INT32, 4, b"\x04\x00\x00\x00")
    assert table.at(param.index) == param
    assert len(table) == len(list(table)) == 879


def test_an_unknown_parameter_is_refused() -> None:
    with pytest.raises(UnknownParamError, match="PX4 has no parameter NO_SUCH"):
        ParamTable({"NO_SUCH": 1.0})
