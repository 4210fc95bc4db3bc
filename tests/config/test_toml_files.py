"""Configuration and controller files: what is wrong is one sentence that names the file and the key."""

import re
from pathlib import Path

import numpy as np
import pytest

from companion.arms.model import JOINT_NAMES
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig, load_config
from companion.config.controller_config import controller_path, load_controller
from companion.config.law_files import LAW_FORM
from companion.config.locations import default_config_path
from companion.control.controller import VehicleModel
from companion.control.delay_predictor import Predictor
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains
from companion.control.pid import Pid
from companion.core.interfaces import ConfigError
from tests.control.by_hand import PRINTED, PRINTED_NUMBERS

VEHICLE = VehicleModel()
PROJECT = Path(__file__).resolve().parents[2]
CONTROLLERS = PROJECT / "config" / "controllers"
PEER_NAMES = "'geometric-pid', 'indi', 'l1', 'mpc'"


def written(folder: Path, text: str, name: str = "mine.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def complaint(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return str(caught.value)


def refusal(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_controller(str(path), VEHICLE, 0.01)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[vehicle]\nmas_kg = 4.0", "vehicle.mas_kg: unknown key, did you mean 'mass_kg'?"),
        ("[flight]\ntakeoff_heigth_m = 1.0", "flight.takeoff_heigth_m: unknown key, did you mean 'takeoff_height_m'?"),
        ("[limit]\nmax_thrust = 0.5", "limit: unknown key, did you mean 'limits'?"),
        (
            "[zzz]\na = 1",
            "zzz: unknown key; known here are arms, control, fence, flight, law, limits, mocap, operator, page, "
            "preflight, px4, records, room, safety, separation, vehicle",
        ),
        ("[vehicle]\nmass_kg = 400.0", "vehicle.mass_kg = 400.0: must be at most 50"),
        ("[vehicle]\nmass_kg = -1", "vehicle.mass_kg = -1: must be above 0.1"),
        ("[vehicle]\nmass_kg = nan", "vehicle.mass_kg = nan: must be a finite number"),
        ("[mocap]\ndelay_s = inf", "mocap.delay_s = inf: must be a finite number"),
        ('[vehicle]\nmass_kg = "4.85"', "vehicle.mass_kg = '4.85': must be a number, without quotes"),
        ("[vehicle]\nmass_kg = true", "vehicle.mass_kg = true: must be a number"),
        ("[mocap]\nport = 22223.0", "mocap.port = 22223.0: must be a whole number"),
        ("[px4]\nurl = 14540", "px4.url = 14540: must be text in quotes"),
        ('[mocap]\nport = "22223"', "mocap.port = '22223': must be a whole number, without quotes"),
        ('[mocap]\ntransport = "UDP"', "mocap.transport = 'UDP': must be 'tcp' or 'udp', did you mean 'udp'?"),
        ('[mocap]\nbody = ""', "mocap.body = '': must not be empty"),
        (
            "[vehicle]\ninertia_kgm2 = [1, 2, 3, 4]",
            "vehicle.inertia_kgm2 = [1, 2, 3, 4]: must have at most 3 values, it has 4",
        ),
        ("[room]\nx_m = true", "room.x_m = true: must be a list of values, as [1.0, 2.0]"),
        ("vehicle = 3", "vehicle = 3: must be a table [vehicle]"),
        ('[mocap]\ntransport = "usb"', "mocap.transport = 'usb': must be 'tcp' or 'udp'"),
        ("[limits]\nmin_thrust = 0.4\nmax_thrust = 0.3", "limits: min_thrust = 0.4 must be below max_thrust = 0.3"),
        ("[control]\nrate_hz = 50", "safety.slow_hz = 50 must be at most 40, 0.8 of control.rate_hz = 50"),
        (
            "[control]\nrate_hz = 20\n[safety]\nslow_hz = 15\ndead_man_s = 0.14",
            "safety.dead_man_s = 0.14 must be at least 0.15, 3 cycles of control.rate_hz = 20",
        ),
        (
            "[fence]\nx_m = [-4, 4]",
            "room.x_m = [-4.0, 4.0] must stay fence.margin_m = 0.3 inside fence.x_m = [-4.0, 4.0]: make the room "
            "smaller, or the fence larger if the net allows",
        ),
        (
            "[room]\ny_m = [-4, 4.3]",
            "room.y_m = [-4.0, 4.3] must stay fence.margin_m = 0.3 inside fence.y_m = [-4.5, 4.5]: make the room "
            "smaller, or the fence larger if the net allows",
        ),
        ("[fence]\ntop_m = 3.2", "room.z_m = [0.3, 3.0] must stay fence.margin_m = 0.3 below fence.top_m = 3.2"),
        (
            "[flight]\ntakeoff_height_m = 3.21",
            "flight.takeoff_height_m = 3.21 must stay fence.margin_m = 0.3 below fence.top_m = 3.5",
        ),
        (
            "[limits]\nmax_tilt_rad = 0.2",
            "fence.braking_mps2 = 2 must be at most 1.99, which limits.max_tilt_rad = 0.2 gives: brake less, "
            "or tilt more",
        ),
        (
            "[limits]\nmax_tilt_rad = 0.7\n[fence]\nbraking_mps2 = 4.91",
            "fence.braking_mps2 = 4.91 must be at most 4.90, which the guard gives below the ceiling: it leaves half "
            "the weight on the rotors, and limits.min_thrust",
        ),
        (
            "[limits]\nmin_thrust = 0.45",
            "fence.braking_mps2 = 2 must be at most 0.98, which the guard gives below the ceiling: it leaves half "
            "the weight on the rotors, and limits.min_thrust",
        ),
        (
            "[limits]\nmax_thrust = 0.5",
            "vehicle.hover_thrust = 0.5 must be above limits.min_thrust = 0.05 and below limits.max_thrust = 0.5",
        ),
        (
            "[vehicle]\nhover_thrust = 0.11\n[limits]\nmin_thrust = 0.11",
            "vehicle.hover_thrust = 0.11 must be above limits.min_thrust = 0.11 and below limits.max_thrust = 0.8",
        ),
        ("[mocap]\ndelay_s = 0.06", "mocap.delay_s = 0.06 must be below safety.delayed_s = 0.06"),
        (
            "[preflight]\nbattery = 0.25",
            "safety.battery_low = 0.25 must be below preflight.battery = 0.25, or a flight ends as it begins",
        ),
        ("[safety]\nbattery_low = 0.1", "safety: battery_critical = 0.12 must be below battery_low = 0.1"),
        ("[safety]\ncoast_s = 0.15", "safety: coast_s = 0.15 must be below degraded_s = 0.1"),
        ("[room]\nx_m = [2, -2]", "room: x_m = [2.0, -2.0]: the first must be below the second"),
        ("[arms]\nfeedforward = 'on'", "arms.feedforward = 'on': must be 'off', 'force' or 'full'"),
        ("[arms.poses]\nhome_rad = [0.1, 0.2]", "arms.poses.home_rad = [0.1, 0.2]: 2 values are too few"),
        ("[arms.servos.'right.claw']\nid = 1", "arms.servos: right.shoulder_pitch and right.claw both have ID 1"),
        (
            "[arms.servos.'right.claw']\nmodel = 'AX-18'",
            "arms.servos.right.claw.model = 'AX-18': must be one of AX-12A, XM430-W350, XM430-W210",
        ),
        (
            "[arms.servos.'right.clow']\nid = 1",
            f"arms.servos: unknown joint 'right.clow'; there are {', '.join(JOINT_NAMES)}",
        ),
        ("[arms.limits.claw]\nmin_rad = 2", "arms.limits.claw: min_rad = 2.0 must be below max_rad = 1.0"),
    ],
)
def test_a_mistake_is_one_sentence_with_file_and_key(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, text)
    assert complaint(path) == f"{path}: {said}"


@pytest.mark.parametrize(
    "text",
    [
        "[control]\nrate_hz = 20\n[safety]\nslow_hz = 15\ndead_man_s = 0.15",
        "[limits]\nmax_tilt_rad = 0.202",
        "[limits]\nmax_tilt_rad = 0.7\n[fence]\nbraking_mps2 = 4.9",
        "[limits]\nmax_thrust = 0.51",
        "[flight]\ntakeoff_height_m = 3.2",
        "[mocap]\ndelay_s = 0.059",
        "[preflight]\nbattery = 0.26",
    ],
)
def test_tables_that_just_agree_are_taken(tmp_path: Path, text: str) -> None:
    load_config(written(tmp_path, text))


@pytest.mark.parametrize("name", ["demo.toml", "lab.toml"])
def test_the_projects_own_files_load(name: str) -> None:
    assert load_config(default_config_path(name)).vehicle.mass_kg == 4.85


def test_what_a_file_says_of_one_joint_leaves_the_others_and_its_other_values_alone(tmp_path: Path) -> None:
    text = (
        "[arms.servos.'right.claw']\nid = 14\n[arms.limits.claw]\nmax_rad = 0.5\n[arms.poses]\nhome_rad = [0.1, 0.2, 0]"
    )
    arms = load_config(written(tmp_path, text)).arms
    assert arms is not None
    assert arms.servos == ArmsConfig().servos | {
        "right.claw": ArmsConfig().servos["right.claw"].model_copy(update={"id": 14})
    }
    assert (arms.limits["claw"].max_rad, arms.limits["claw"].max_velocity_radps) == (0.5, 4.0)
    assert arms.poses.home_rad == (0.1, 0.2, 0.0)


def test_pairs_and_triples_can_be_set_from_a_file(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, "[room]\nx_m = [-1, 1.5]\n[vehicle]\ninertia_kgm2 = [0.1, 0.2, 0.3]"))
    assert config.room.x_m == (-1.0, 1.5)
    assert config.vehicle.inertia_kgm2 == (0.1, 0.2, 0.3)


def test_a_table_that_is_none_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, "vehicle = 3")
    assert complaint(path).startswith(f"{path}: vehicle = 3: ")


def test_every_mistake_has_its_own_line(tmp_path: Path) -> None:
    path = written(tmp_path, "[vehicle]\nmass_kg = 0.0\n[control]\nrate_hz = 5.0\n[px4]\nurll = 'x'")
    lines = complaint(path).splitlines()
    assert len(lines) == 3
    for line, key in zip(sorted(lines), ("control.rate_hz", "px4.urll", "vehicle.mass_kg"), strict=True):
        assert line.startswith(f"{path}: {key}")


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "nowhere.toml"
    assert complaint(path) == f"{path}: there is no such file"


def test_what_is_not_toml_is_one_sentence_with_the_line(tmp_path: Path) -> None:
    said = complaint(written(tmp_path, "[vehicle]\nmass_kg = = 3"))
    assert re.fullmatch(r".*mine\.toml: not valid TOML: .*line 2.*", said)


@pytest.mark.parametrize("before", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"], ids=["LF", "CRLF"])
def test_a_file_from_a_windows_editor_is_read(tmp_path: Path, before: bytes, end: bytes) -> None:
    path, law = tmp_path / "mine.toml", tmp_path / "law.toml"
    path.write_bytes(before + end.join([b"[vehicle]", b"mass_kg = 5.5", b""]))
    assert load_config(path).vehicle.mass_kg == 5.5
    law.write_bytes(before + end.join([b'law = "pid"', b"gains.kp_per_s2 = [1.4, 1.4, 1.9]", b""]))
    assert load_controller(str(law), VEHICLE, 0.01).name == str(law)


def test_a_file_in_utf_16_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    for kind in ("utf-16", "utf-16-le", "utf-16-be"):
        path.write_bytes("[vehicle]\nmass_kg = 5.5\n".encode(kind))
        assert complaint(path) == f"{path}: is UTF-16 or no text at all: save it as UTF-8"
        assert refusal(path) == complaint(path)


def test_what_is_not_text_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"[vehicle]\n# caf\xe9")
    assert complaint(path) == f"{path}: line 2: the byte 0xe9 is no UTF-8: save it as UTF-8"
    assert complaint(tmp_path) == f"{tmp_path}: is a folder: give the name of a file"


def test_an_empty_file_is_the_defaults(tmp_path: Path) -> None:
    assert load_config(written(tmp_path, "")) == CompanionConfig()


def test_whole_numbers_may_stand_for_reals(tmp_path: Path) -> None:
    assert load_config(written(tmp_path, "[control]\nrate_hz = 200")).control.rate_hz == 200.0


def test_the_files_values_reach_the_models_they_are_for(tmp_path: Path) -> None:
    config = load_config(
        written(
            tmp_path,
            "[vehicle]\nmass_kg = 3.0\nthrust_curve = 0.3\nattitude_bandwidth_radps = 9.0\nattitude_damping = 0.7\n"
            "thrust_lag_s = 0.06\nsetpoint_delay_s = 0.05\nthrust_delay_s = 0.02\ngravity_mps2 = 9.81\n"
            "hover_thrust = 0.4\n[mocap]\ndelay_s = 0.008\n[limits]\nmax_tilt_rad = 0.4",
        )
    )
    assert config.vehicle_model() == VehicleModel(
        mass_kg=3.0,
        gravity_mps2=9.81,
        attitude_bandwidth_radps=9.0,
        attitude_damping=0.7,
        thrust_lag_s=0.06,
        setpoint_delay_s=0.05,
        thrust_delay_s=0.02,
        mocap_age_s=0.008,
    )
    model = config.vehicle.thrust_model()
    assert (model.mass_kg, model.gravity_mps2, model.hover_thrust, model.curve) == (3.0, 9.81, 0.4, 0.3)
    limits = config.limits.limits()
    assert (limits.max_tilt_rad, limits.max_thrust) == (0.4, 0.8)


# --- controllers ---


def test_the_papers_file_is_refused_with_one_sentence_and_both_numbers() -> None:
    said = refusal(CONTROLLERS / "paper.toml")
    assert "\n" not in said
    assert str(CONTROLLERS / "paper.toml") in said
    assert "gains.rho / gains.filter_eps = 0.333" in said
    assert "k + s = 16.1" in said, "z: 4 + 1.2 * 10.07"
    assert "allow_unstable = true" in said
    assert "--allow-unstable" in said


def test_the_papers_file_loads_when_that_is_asked_for_and_is_the_printed_law(tmp_path: Path) -> None:
    text = (CONTROLLERS / "paper.toml").read_text(encoding="utf-8")
    path = written(tmp_path, text.replace("allow_unstable = false", "allow_unstable = true"))
    law = load_controller(str(path), VEHICLE, 0.01).law
    assert isinstance(law, Etnn)
    for name, diagonal in PRINTED.items():
        np.testing.assert_array_equal(getattr(law.gains, name), diagonal, err_msg=name)
    for name, number in PRINTED_NUMBERS.items():
        assert getattr(law.gains, name) == number, name
    assert law.gains.model_dump() == EtnnGains().model_dump(), "the defaults of the type are the print, too"
    assert law.gains.power_regularisation == 0.0
    assert law.gains.boundary_layer_mps == 0.0
    assert law.gains.switching == 1.0
    assert not law.gains.every_cycle
    assert law.predictor is None, "the print predicts nothing"
    assert law.preview_s == 0.0


def test_the_set_that_flies_and_the_baseline_load() -> None:
    practical = load_controller("practical", VEHICLE, 0.01)
    assert isinstance(practical.law, Etnn)
    damping, needed = practical.law.gains.filter_loop()
    assert damping > needed, "what flies meets the condition"
    assert controller_path("etnn") == controller_path("practical"), "the name of the law is the set that flies"
    pid = load_controller("pid", VEHICLE, 0.01)
    assert isinstance(pid.law, Pid)
    gains = pid.law.gains
    np.testing.assert_allclose(4.85 * gains.kp_per_s2, [8.0, 8.0, 10.0], rtol=1e-4)
    np.testing.assert_allclose(4.85 * gains.ki_per_s3, [1.5, 1.5, 8.0], rtol=1e-4)
    np.testing.assert_allclose(4.85 * gains.kd_per_s, [10.0, 10.0, 13.0], rtol=1e-4)


def test_the_papers_file_loads_when_the_caller_allows_it() -> None:
    loaded = load_controller("paper", VEHICLE, 0.01, allow_unstable=True)
    assert isinstance(loaded.law, Etnn)
    assert loaded.law.gains.model_dump() == EtnnGains().model_dump()
    assert loaded.description == "as printed; unstable", "as the file says"


def test_what_the_file_says_of_the_prediction_reaches_the_predictor(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        'law = "etnn"\nallow_unstable = true\n[prediction]\nenabled = true\nlead_s = 0.05\nthrust_lead_s = 0.02\n'
        "observer_radps = 1.5",
    )
    law = load_controller(str(path), VEHICLE, 0.02).law
    assert isinstance(law, Etnn)
    assert law.predictor == Predictor(VEHICLE, 0.02, 0.05, 0.02, 1.5)
    assert "prediction.observer_radps = -1.0" in refusal(
        written(tmp_path, 'law = "etnn"\n[prediction]\nobserver_radps = -1.0')
    )


@pytest.mark.parametrize(("rho", "loads"), [(1.0, True), (0.3 * 13.07, True), (0.3 * 13.06, False), (0.1, False)])
def test_the_refusal_begins_where_the_condition_ends(tmp_path: Path, rho: float, loads: bool) -> None:
    """k = 3 and k_1 = 1 on all axes: k + s = 3 + 10.067."""
    path = written(
        tmp_path,
        f'law = "etnn"\n[gains]\nk = [3.0, 3.0, 3.0]\nk1 = [1.0, 1.0, 1.0]\nrho = {rho}\n'
        f"filter_eps = {0.05 if rho == 1.0 else 0.3}",
    )
    if loads:
        assert isinstance(load_controller(str(path), VEHICLE, 0.01).law, Etnn)
    else:
        assert "is unstable" in refusal(path)


@pytest.mark.parametrize(
    ("eps", "period_s", "loads"), [(0.004, 0.01, False), (0.004, 0.002, True), (0.008, 0.01, True)]
)
def test_a_filter_too_quick_for_the_control_period_is_refused(
    tmp_path: Path, eps: float, period_s: float, loads: bool
) -> None:
    """rho = 1, zeta = 0.5: 2 * 2.5 + 0.5 * 2.5^2 = 8.1 at 4 ms and 10 ms, although rho/eps = 250 is far above k + s."""
    path = written(tmp_path, f'law = "etnn"\n[gains]\nrho = 1.0\nfilter_eps = {eps}')
    if loads:
        load_controller(str(path), VEHICLE, period_s)
        return
    with pytest.raises(ConfigError, match=r"filter_eps = 0\.004 is too quick for steps of 0\.01 s.* = 8\.12"):
        load_controller(str(path), VEHICLE, period_s)


def test_an_unknown_controller_names_those_there_are() -> None:
    with pytest.raises(ConfigError) as caught:
        load_controller("etn", VEHICLE, 0.01)
    said = str(caught.value)
    assert said.startswith(
        "unknown controller 'etn': give a TOML file, 'etnn', or one of geometric-pid, indi, l1, mpc, paper, "
        "paper-repaired, pid, practical"
    )
    assert "\n" not in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", f"has no law: a controller file says law = 'etnn', 'pid', {PEER_NAMES}, or {LAW_FORM}"),
        ('law = "lqr"', f"law = 'lqr': must be 'etnn', 'pid', {PEER_NAMES}, or {LAW_FORM}"),
        ("law = 3", f"law = 3: must be 'etnn', 'pid', {PEER_NAMES}, or {LAW_FORM}"),
        ('law = "etnn"\n[gains]\nsgima = 0.1', "gains.sgima: unknown key, did you mean 'sigma'?"),
        ('law = "etnn"\n[gains]\np = 0.4', "gains.p = 0.4: must be above 0.5"),
        ('law = "etnn"\n[gains]\nsigma = "0.1"', "gains.sigma = '0.1': must be a number, without quotes"),
        ('law = "etnn"\n[gains]\nc1 = [1.0, 1.0]', "gains: c1 must be 3 positive numbers, not [1.0, 1.0]"),
        ('law = "etnn"\n[gains]\nk = "x"', "gains.k = 'x': must be a list of numbers, not 'x'"),
        ('law = "etnn"\nalow_unstable = true', "alow_unstable: unknown key, did you mean 'allow_unstable'?"),
        ('law = "etnn"\n[prediction]\nenabled = 1', "prediction.enabled = 1: must be true or false"),
        ('law = "pid"\n[gains]\nkp_per_s = 1', "gains.kp_per_s: unknown key, did you mean 'kp_per_s2'?"),
    ],
)
def test_a_mistake_in_a_controller_file_is_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, text)
    found = refusal(path)
    assert found in (f"{path}: {said}", f"{path}: {said.removeprefix('gains: ')}")
