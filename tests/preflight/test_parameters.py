"""The recommended list: what it accepts, what it says, and that the demo's vehicle has it."""

import math
from pathlib import Path

import pytest

from companion.config.preflight_config import Recommended, load_recommended
from companion.core.interfaces import ConfigError
from companion.preflight.checks.vehicle import check_parameters
from mock_autopilot.config import MockConfig
from mock_autopilot.px4.params import ParamTable

ROOT = Path(__file__).resolve().parents[2]
LIST = load_recommended("recommended")


def of_the_mock(changed: dict[str, float]) -> dict[str, float]:
    table = ParamTable(changed)
    return {name: table[name] for name in LIST}


def test_every_parameter_of_the_list_is_one_of_the_recorded_px4() -> None:
    table = ParamTable()
    assert [name for name in LIST if table.find(name) is None] == []


def test_the_demos_vehicle_has_all_that_is_recommended() -> None:
    changed = MockConfig.load(ROOT / "config" / "mock.toml").px4.params
    failed = [check for check in check_parameters(LIST, of_the_mock(dict(changed))) if not check.passed]
    assert failed == []


def test_a_px4_as_it_comes_out_of_the_box_is_refused_for_what_would_hurt_indoors() -> None:
    checks = check_parameters(LIST, of_the_mock({}))
    assert {check.name for check in checks if check.refuses} == {
        "COM_OF_LOSS_T",
        "COM_OBL_RC_ACT",
        "COM_RC_OVERRIDE",
        "NAV_RCL_ACT",
        "COM_LOW_BAT_ACT",
        "EKF2_EV_CTRL",
        "EKF2_HGT_REF",
        "EKF2_RNG_CTRL",
        "EKF2_EVP_NOISE",
        "EKF2_EVA_NOISE",
        "EKF2_GPS_CTRL",
        "EKF2_MAG_TYPE",
    }
    assert {check.name for check in checks if not check.passed and not check.refuses} == {
        "COM_RC_IN_MODE",
        "RC_MAP_FLTMODE",
        "RC_MAP_KILL_SW",
        "RTL_RETURN_ALT",
        "EKF2_OF_CTRL",
        "SYS_HAS_GPS",
        "SYS_HAS_MAG",
        "SENS_IMU_AUTOCAL",
        "MPC_XY_VEL_MAX",
        "MPC_Z_VEL_MAX_UP",
        "MPC_Z_VEL_MAX_DN",
    }


def wrong_value(name: str) -> float:
    """Return PX4's own value where that is wrong, else one that its condition excludes."""
    one = LIST[name]
    most, least = (0.0 if bound is None else bound for bound in (one.at_most, one.at_least))
    tried = (ParamTable()[name], most + 1.0, least - 1.0, max(one.one_of, default=0.0) + 1.0, 0.0)
    return next(value for value in tried if not one.accepts(value))


@pytest.mark.parametrize("name", LIST)
def test_each_wrong_value_is_named_with_the_value_to_set_and_why(name: str) -> None:
    one = LIST[name]
    checks = check_parameters(LIST, {wanted: row.set_to for wanted, row in LIST.items()} | {
        name: wrong_value(name)
    })  # fmt: skip
    [check] = [check for check in checks if not check.passed]
    assert (check.name, check.must) == (name, one.must)
    assert check.says == f"is {wrong_value(name):g}, should be {one.wanted}"
    assert check.todo == f"set it to {one.set_to:g}{' and reboot PX4' if one.reboot else ''}: {one.why}"


def test_a_px4_without_a_sensor_or_of_another_release_is_right_without_its_parameter() -> None:
    found = {name: one.set_to for name, one in LIST.items() if not one.optional}
    assert {"EKF2_RNG_CTRL", "EKF2_OF_CTRL", "EKF2_MAG_TYPE"} <= set(LIST) - set(found)
    checks = check_parameters(LIST, found)
    assert [check.name for check in checks if not check.passed] == []
    assert {check.says for check in checks if check.name not in found} == {"this PX4 does not have it"}
    silent = check_parameters(LIST, {})
    assert not any(check.passed for check in silent), "who tells nothing at all is not heard"


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("EKF2_EV_CTRL", (11.0, 15.0), (0.0, 3.0, 7.0)),
        ("COM_OF_LOSS_T", (0.2, 0.5, 0.5000000001), (0.0, 0.51, 1.0)),
        ("COM_OBL_RC_ACT", (4.0,), (0.0, 3.0, 5.0, 6.0, 7.0)),
        ("NAV_DLL_ACT", (0.0, 3.0), (1.0, 2.0, 5.0, 6.0)),
        ("COM_RC_OVERRIDE", (2.0, 3.0), (0.0, 1.0)),
    ],
)
def test_values(name: str, good: tuple[float, ...], bad: tuple[float, ...]) -> None:
    assert all(LIST[name].accepts(value) for value in good)
    assert not any(LIST[name].accepts(value) for value in bad)


def test_a_failed_one_says_what_is_what_should_be_what_to_do_and_why() -> None:
    [check] = check_parameters({"EKF2_EV_CTRL": LIST["EKF2_EV_CTRL"]}, {"EKF2_EV_CTRL": 3.0})
    assert check.refuses
    assert check.says == "is 3, should be bits 0, 1, 3 set"
    assert check.todo.startswith("set it to 15 and reboot PX4: ")
    assert LIST["EKF2_EV_CTRL"].why in check.todo


def test_what_the_autopilot_does_not_tell_fails() -> None:
    wanted = {name: Recommended(set_to=1.0, why="why", must=name == "A", one_of=(1.0,)) for name in ("A", "B")}
    first, second = check_parameters(wanted, {"A": math.nan})
    assert first.refuses
    assert not second.passed
    assert not second.refuses


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[A]\nset_to = 1\nwhy = "x"\n', "A: needs a condition"),
        ('[A]\nset_to = 1\nwhy = "x"\nat_least = 2\n', "A: set_to = 1 does not meet its own condition: at least 2"),
        ('[A]\nset_to = 1\nwhy = "x"\nmost = 2\n', "A.most: unknown key"),
        ("[A]\nset_to = 1\nat_most = 2\n", "A.why: is missing"),
    ],
)
def test_a_list_of_ones_own_with_a_mistake_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=sentence):
        load_recommended(str(path))


def test_an_unknown_list_names_where_lists_are() -> None:
    with pytest.raises(ConfigError, match="'nowhere': is no file, and no name in"):
        load_recommended("nowhere")


def row(name: str, one: Recommended) -> str:
    """Return the line of docs/preflight.md."""
    accepted = f"{one.wanted}{'; or missing' if one.optional else ''}{'; then reboot' if one.reboot else ''}"
    before = f"| `{name}` | {ParamTable()[name]:.4g} | {one.set_to:g} | {accepted} "
    return f"{before}| {'must' if one.must else 'should'} | {one.why} |"


def test_the_documentation_prints_this_very_list() -> None:
    text = (ROOT / "docs" / "preflight.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| `") and line.count("|") == 7]
    assert rows == [row(name, one) for name, one in LIST.items()]
