"""Controller files against the vehicle that is configured: what is said of them, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController, load_controller
from companion.config.law_margin import margin_of, measured, require_margin
from companion.control.controller import VehicleModel
from companion.core.interfaces import ConfigError
from companion.preflight.service_facts import check_configured_law
from companion.service import margin_process
from companion.service.planning import load_law
from tests import warm
from tests.flights.command import ROOT

VEHICLE = CompanionConfig().vehicle_model()
SLOW = replace(VEHICLE, attitude_bandwidth_radps=5.0)
NEWTONS_ON_1_KG = """law = "pid"
[gains]
kp_per_s2 = [8.0, 8.0, 10.0]
ki_per_s3 = [1.5, 1.5, 8.0]
kd_per_s = [10.0, 10.0, 13.0]
"""
SHIPPED = {
    "demo, lab": VEHICLE,
    "recorded slow loop": replace(VEHICLE, attitude_bandwidth_radps=6.3),
    "experiments": VehicleModel(
        mass_kg=4.85,
        gravity_mps2=9.8,
        attitude_bandwidth_radps=10.0,
        attitude_damping=0.8,
        thrust_lag_s=0.06,
        setpoint_delay_s=0.02,
        thrust_delay_s=0.02,
        mocap_age_s=0.02,
    ),
    "1 kg, recorded": VehicleModel(
        mass_kg=1.0,
        gravity_mps2=9.8,
        attitude_bandwidth_radps=11.0,
        attitude_damping=0.99,
        thrust_lag_s=0.044,
        setpoint_delay_s=0.063,
        thrust_delay_s=0.01,
        mocap_age_s=0.01,
    ),
}


def loaded(name: str, vehicle: VehicleModel, allow_unstable: bool = False) -> LoadedController:
    return load_controller(name, vehicle, 0.01, allow_unstable)


@pytest.fixture
def steep(tmp_path: Path) -> Path:
    path = tmp_path / "steep.toml"
    path.write_text(NEWTONS_ON_1_KG, encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", SHIPPED.values(), ids=SHIPPED)
@pytest.mark.parametrize("name", ["practical", "pid"])
def test_what_is_shipped_has_margin_on_every_vehicle_that_is(name: str, vehicle: VehicleModel) -> None:
    margin = require_margin(loaded(name, vehicle), vehicle, 0.01)
    assert margin.says.startswith("phase margin "), margin.says


@pytest.mark.parametrize("name", ["paper-repaired", str(ROOT / "examples" / "own_law" / "sliding_mode.toml")])
def test_what_chatters_or_has_a_trigger_of_its_own_is_said_not_to_be_checked(name: str) -> None:
    margin = require_margin(loaded(name, VEHICLE), VEHICLE, 0.01)
    assert margin.says.startswith("margin not checked: its command never comes to rest along "), margin.says


def test_on_a_slow_attitude_loop_it_is_refused_with_what_was_found_what_is_wanted_and_what_to_do() -> None:
    with pytest.raises(ConfigError) as refused:
        require_margin(loaded("practical", SLOW), SLOW, 0.01)
    found, wanted = str(refused.value).split("; ", maxsplit=1)
    assert found.startswith("practical: phase margin 10 degrees along x at 5.0 rad/s, gain margin 1.8")
    assert "on this vehicle (attitude loop 5 rad/s, damping 0.8, setpoint delay 0.04 s" in found
    assert wanted.startswith("at least 20 degrees and a gain margin of 1.5 are wanted: lower its gains")
    assert "`companion calibrate`" in wanted
    assert not require_margin(loaded("practical", SLOW, allow_unstable=True), SLOW, 0.01).enough


def test_gains_that_swing_are_refused_before_the_law_is_switched(steep: Path) -> None:
    with pytest.raises(ConfigError, match=r"no phase margin .* it swings along x at 1\.0 Hz; at least 20"):
        load_law(str(steep), CompanionConfig())
    assert load_law("pid", CompanionConfig())


def test_the_preflight_looks_at_the_law_that_is_configured(steep: Path, tmp_path: Path) -> None:
    config = CompanionConfig()
    assert check_configured_law(config).passed

    def with_law(name: str) -> CompanionConfig:
        return config.model_copy(update={"control": config.control.model_copy(update={"controller": name})})

    swings = check_configured_law(with_law(str(steep)))
    assert swings.refuses
    assert "no phase margin" in swings.says
    absent = check_configured_law(with_law(str(tmp_path / "none.toml")))
    assert absent.refuses
    assert "there is no such file" in absent.says


@pytest.mark.slow
def test_the_commands_refuse_it_in_one_sentence(steep: Path) -> None:
    for command in (["simulate", "--demo"], ["demo"], ["serve", "--config", str(ROOT / "config" / "demo.toml")]):
        ran = warm.run("companion.cli.main", *command, "--controller", str(steep))
        assert ran.returncode == 2, ran.stderr
        (said,) = [line for line in ran.stderr.splitlines() if "margin" in line]
        assert said.startswith(f"companion: {steep}: no phase margin"), said
        assert "Traceback" not in ran.stderr


def test_a_users_law_that_cannot_be_measured_is_not_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        """import numpy as np
from companion.control.controller import ControlOutput

class Mine:
    preview_s = 0.0

    def __init__(self, gains, vehicle, period_s):
        pass

    def initial(self, first):
        return 0

    def step(self, memory, now):
        if memory > 100:
            raise ZeroDivisionError("after a second")
        error = now.position_w_m + now.velocity_w_mps
        return memory + 1, ControlOutput(-error, np.ones_like(error[..., :1]), {})
""",
        encoding="utf-8",
    )
    (tmp_path / "mine.toml").write_text('law = "mine.py:Mine"\n', encoding="utf-8")
    margin = margin_of(loaded(str(tmp_path / "mine.toml"), VEHICLE), VEHICLE, 0.01)
    assert margin.enough
    assert margin.says == "margin not checked: its step raised ZeroDivisionError: after a second"


def test_in_a_process_of_its_own_it_is_the_same_and_what_fails_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pid = loaded("pid", VEHICLE)
    assert repr(margin_process.measure_apart(pid, VEHICLE, 0.01)) == repr(measured(pid, VEHICLE, 0.01))
    monkeypatch.setattr(margin_process, "_WITHIN_S", 0.01)
    with pytest.raises(ConfigError, match="pid: its stability margin could not be measured, try again: 0 s were not"):
        margin_process.measure_apart(pid, VEHICLE, 0.01)
    monkeypatch.setattr("sys.executable", "/bin/false")
    monkeypatch.setattr(margin_process, "_WITHIN_S", 7.0)
    with pytest.raises(ConfigError, match="try again: exit code 1"):
        margin_process.measure_apart(pid, VEHICLE, 0.01)
