"""Tests of all checks: a ready vehicle passes, and each fault fails its own check with a remedy."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.config.mocap_config import MocapConfig
from companion.config.operator_config import OperatorConfig
from companion.config.preflight_config import PreflightConfig
from companion.config.separation_config import SeparationConfig
from companion.core.interfaces import ConfigError
from companion.core.types import Array, AutopilotStatus, BatteryReading, OtherService, Reference
from companion.geometry.frames import quat_from_rotation_vector, quat_from_yaw
from companion.preflight.checks.agreement import Difference, VisionFacts, apart, check_heading, check_tilts
from companion.preflight.checks.all_checks import Facts, check_all
from companion.preflight.checks.check import Check, refusal
from companion.preflight.checks.hand_test import HandTest
from companion.trajectories.reference import Ellipse, LapTiming
from companion.trajectories.room_check import check_trajectory
from tests.preflight.facts import ARMS, MACHINE, MOCAP, RECOMMENDED, STATUS, mock_parameters, ready

CONFIG = CompanionConfig(arms=ArmsConfig(), operator=OperatorConfig())
WANTED = PreflightConfig()


def failed(facts: Facts, wanted: PreflightConfig = WANTED, config: CompanionConfig = CONFIG) -> list[Check]:
    return [check for check in check_all(facts, config, wanted, RECOMMENDED) if not check.passed]


def test_a_ready_vehicle_may_arm() -> None:
    assert failed(ready()) == []
    assert refusal(check_all(ready(), CONFIG, WANTED, RECOMMENDED)) == ""


def others(*bodies: str, order: tuple[str, ...] = ()) -> list[Check]:
    """The line on other vehicles, whose names are those of their bodies in capitals."""
    config = CompanionConfig(separation=SeparationConfig(order=order), mocap=MocapConfig(body="dauam"))
    facts = replace(ready(), others=tuple(OtherService(body.upper(), body) for body in bodies))
    return [check for check in check_all(facts, config, WANTED, RECOMMENDED) if check.name == "other vehicles"]


def test_a_vehicle_that_is_not_in_the_order_of_separation_is_refused() -> None:
    order = ("dauam", "two")
    assert others() == []
    assert [check.passed for check in others(order=order)] == [True]
    assert [check.says for check in others("two", order=order)] == [
        "on the broker: TWO (body two); separation knows them"
    ]
    (stranger,) = others("two", "three", order=order)
    assert stranger.refuses
    assert stranger.says == "on the broker, and not in separation.order: THREE (body three)"
    (warning,) = others("two")
    assert (warning.passed, warning.refuses) == (False, False)
    assert "no separation is configured, so nothing keeps them apart" in warning.says


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"mocap": replace(MOCAP, tracked=140)}, "body seen"),
        ({"mocap": replace(MOCAP, frames=120, tracked=120)}, "mocap rate"),
        ({"mocap": replace(MOCAP, age_s=0.06)}, "mocap age"),
        ({"mocap": replace(MOCAP, residual_m=0.004)}, "mocap residual"),
        ({"mocap": replace(MOCAP, delay_s=0.04)}, "vision delay"),
        ({"position_w_m": np.array([4.3, 0.0, 0.0])}, "fence around the vehicle"),
        ({"position_w_m": np.array([0.0, 0.0, 2.1])}, "fence around the vehicle"),
        ({"position_w_m": None}, "fence around the vehicle"),
        ({"status": replace(STATUS, heard_s=99.0)}, "autopilot heard"),
        ({"operator_age_s": 0.1}, "operator's broker"),
        ({"status": replace(STATUS, connected=False)}, "autopilot heard"),
        ({"status": replace(STATUS, armed=True)}, "disarmed"),
        ({"status": replace(STATUS, in_air=True)}, "disarmed"),
        ({"status": replace(STATUS, in_air=None)}, "disarmed"),
        ({"status": replace(STATUS, heartbeat_s=-math.inf)}, "disarmed"),
        ({"status": replace(STATUS, battery_fraction=0.45)}, "battery"),
        ({"status": replace(STATUS, battery_fraction=math.nan)}, "battery"),
        ({"status": replace(STATUS, battery_fraction=-0.01)}, "battery"),
        ({"status": replace(STATUS, system_id=1, other_autopilots=("system 2 (PX4)",))}, "one autopilot"),
        ({"apart": Difference(0.06, 0.0, 0.0)}, "roll agrees"),
        ({"apart": Difference(0.0, -0.06, 0.0)}, "pitch agrees"),
        ({"apart": Difference(0.0, 0.0, -0.11)}, "heading agrees"),
        ({"vision": VisionFacts(False, 0.01)}, "vision fused"),
        ({"vision": VisionFacts(True, 0.15)}, "vision fused"),
        ({"vision": VisionFacts(True, math.nan)}, "vision fused"),
        ({"parameters": mock_parameters() | {"EKF2_EV_DELAY": 175.0}}, "vision delay"),
        ({"parameters": mock_parameters() | {"MPC_THR_HOVER": 0.35}}, "hover thrust"),
        ({"parameters": mock_parameters() | {"MPC_THR_HOVER": math.nan}}, "hover thrust"),
        ({"parameters": mock_parameters() | {"THR_MDL_FAC": math.nan}}, "thrust curve"),
        ({"parameters": mock_parameters() | {"COM_OF_LOSS_T": 1.0}}, "COM_OF_LOSS_T"),
        ({"arms": replace(ARMS, fault="left.claw (ID 8) is silent")}, "arms present"),
        ({"arms": replace(ARMS, unread_s=math.inf)}, "arms present"),
        ({"arms": replace(ARMS, off_stow="left.elbow_pitch is 20 degrees from its stowed angle")}, "arms stowed"),
        ({"machine": replace(MACHINE, disk_free_mb=250.0)}, "disk space"),
        ({"machine": replace(MACHINE, clock_resolution_s=0.004)}, "clock"),
        ({"machine": replace(MACHINE, clock_sane=False)}, "clock"),
        ({"machine": replace(MACHINE, realtime_priority=0)}, "real-time priority"),
        ({"kept": "never: there is no /var/lib/dauam/by_hand.json"}, "carried by hand"),
        ({"kept": HandTest("drone", ready().when)}, "carried by hand"),
    ],
)
def test_what_is_wrong_refuses_arming_and_says_what_to_do(change: dict[str, Any], name: str) -> None:
    [check] = failed(replace(ready(), **change))
    assert check.name == name
    assert check.refuses
    assert check.says
    assert check.todo
    text = refusal([check])
    assert text.startswith("a preflight check fails\n")
    assert check.says in text
    assert check.todo in text


def test_a_second_autopilot_may_be_there_where_a_number_says_which_is_flown() -> None:
    heard = replace(ready(), status=replace(STATUS, system_id=1, other_autopilots=("system 2 (PX4)",)))
    numbered = CONFIG.model_copy(update={"px4": CONFIG.px4.model_copy(update={"system_id": 1})})
    assert failed(heard, config=numbered) == []
    [check] = failed(heard)
    assert "system 1" in check.says
    assert "system 2 (PX4)" in check.says
    assert "px4.system_id" in check.todo


def test_two_autopilots_of_one_number_are_refused_also_where_that_number_is_configured() -> None:
    same = replace(STATUS, system_id=1, other_autopilots=("system 1 (PX4 at 127.0.0.1:14599)",))
    numbered = CONFIG.model_copy(update={"px4": CONFIG.px4.model_copy(update={"system_id": 1})})
    for config in (CONFIG, numbered):
        (check,) = failed(replace(ready(), status=same), config=config)
        assert check.refuses
        assert check.says.endswith("another has the same number: system 1 (PX4 at 127.0.0.1:14599)")


SERVOS, FLIGHT = (BatteryReading(id=n, fraction=f, voltage_v=v) for n, f, v in ((1, 0.12, 10.9), (0, 0.95, 16.4)))


def battery(status: AutopilotStatus) -> Check:
    checks = check_all(replace(ready(), status=status), CONFIG, WANTED, RECOMMENDED)
    return next(check for check in checks if check.name == "battery")


def test_every_battery_is_named_where_there_are_two_and_the_flight_battery_counts() -> None:
    check = battery(replace(STATUS, battery_id=0, batteries=(FLIGHT, SERVOS)))
    assert check.passed
    assert check.says == "battery 0: 95%, 16.4 V; battery 1: 12%, 10.9 V; at least 50% of battery 0 wanted"


def test_a_charge_of_minus_one_is_not_an_empty_battery() -> None:
    check = battery(replace(STATUS, battery_fraction=-0.01))
    assert check.says == "its charge is not known"
    assert "BAT1_N_CELLS" in check.todo


def test_a_configured_battery_that_is_not_heard_is_named() -> None:
    check = battery(replace(STATUS, battery_fraction=math.nan, battery_id=2, batteries=(FLIGHT,)))
    assert check.says == "battery 2 is not heard, only battery 0: 95%, 16.4 V"
    assert "px4.battery_id" in check.todo


def test_a_missing_body_fails_all_that_depends_on_it_without_an_exception() -> None:
    nothing = replace(MOCAP, frames=0, tracked=0, age_s=math.inf, delay_s=math.nan, residual_m=math.nan)
    unknown = Difference(math.nan, math.nan, math.nan)
    facts = replace(ready(), mocap=nothing, position_w_m=None, apart=unknown, parameters={})
    names = {check.name for check in failed(facts)}
    assert {"body seen", "mocap rate", "mocap age", "heading agrees", "roll agrees", "vision delay"} <= names
    assert RECOMMENDED.keys() <= names, "an autopilot that tells none of its parameters"


def test_a_setting_left_in_a_servo_is_a_warning_with_what_to_do() -> None:
    remark = "right.shoulder_pitch (ID 1) has Homing Offset 100, which is lost: set it to 0"
    [check] = failed(replace(ready(), arms=replace(ARMS, remarks=(remark,))))
    assert (check.name, check.must) == ("arms set up", False)
    assert (check.says, check.todo) == tuple(remark.split(": "))


def test_warnings_do_not_refuse() -> None:
    facts = replace(ready(), machine=replace(MACHINE, clock_synchronised=False, realtime_priority=0))
    relaxed = PreflightConfig(realtime=False, by_hand_within_h=0.0)
    checks = failed(replace(facts, kept="never: there is no /var/lib/dauam/by_hand.json"), relaxed)
    assert [(check.name, check.must) for check in checks] == [
        ("clock synchronised", False),
        ("real-time priority", False),
    ]
    assert refusal(checks) == ""


def test_a_niceness_will_do_for_a_real_time_priority() -> None:
    assert failed(replace(ready(), machine=replace(MACHINE, realtime_priority=0, nice=-15))) == []


def test_a_curve_that_is_corrected_twice_is_refused() -> None:
    curved = CONFIG.model_copy(update={"vehicle": CONFIG.vehicle.model_copy(update={"thrust_curve": 0.4})})
    assert failed(ready(), config=curved) == []
    both = replace(ready(), parameters=mock_parameters() | {"THR_MDL_FAC": 0.3})
    assert [check.name for check in failed(both, config=curved)] == ["thrust curve"]
    assert failed(both) == []


def test_a_vehicle_without_arms_is_not_asked_for_them() -> None:
    names = [check.name for check in check_all(replace(ready(), arms=None), CompanionConfig(), WANTED, RECOMMENDED)]
    assert not any("arms" in name for name in names)


def test_every_failed_check_stands_in_the_refusal() -> None:
    facts = replace(
        ready(), kept="never: there is no /var/lib/dauam/by_hand.json", status=replace(STATUS, battery_fraction=0.1)
    )
    text = refusal(check_all(facts, CONFIG, WANTED, RECOMMENDED))
    assert text.splitlines()[0] == "2 preflight checks fail"
    assert "battery: 10%" in text
    assert "carried by hand: never" in text


@pytest.mark.parametrize(
    ("size_m", "period_s", "centre_m", "good"),
    [
        (1.0, 15.0, 0.0, True),
        (1.0, 15.0, 3.0, True),
        (1.0, 15.0, 3.3, False),
        (3.0, 4.0, 1.1, False),
        (1.0, 5.0, 3.0, False),
        (1.0, 5.0, 2.85, True),
    ],
)
def test_a_trajectory_must_stay_inside_and_be_able_to_brake(
    size_m: float, period_s: float, centre_m: float, good: bool
) -> None:
    centre = np.array([centre_m, 0.0, 1.2])
    ellipse = Ellipse(centre, (size_m, 0.6 * size_m), LapTiming(period_s, 2))
    checks = check_all(ready(), CONFIG, WANTED, RECOMMENDED, ellipse)
    [check] = [check for check in checks if check.name == "fence around the trajectory"]
    assert check.passed is good
    assert good or "at " in check.todo


def _pairs(mocap: Array, autopilot: Array) -> Difference:
    return apart(np.tile(mocap, (20, 1)), np.tile(autopilot, (20, 1)))


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, 3.1, -2.0])
def test_attitudes_are_compared_axis_by_axis_whatever_the_heading(heading_rad: float) -> None:
    level = quat_from_yaw(heading_rad)
    off = _pairs(level, quat_from_yaw(heading_rad + 0.2))
    assert (off.roll_rad, off.pitch_rad, off.heading_rad) == pytest.approx((0.0, 0.0, 0.2), abs=1e-9)


@pytest.mark.parametrize(
    ("turned", "roll_deg", "pitch_deg"),
    [((0.2, 0.0, 0.0), 11.5, 0.0), ((0.0, 0.2, 0.0), 0.0, -11.5), ((math.pi, 0.0, 0.0), 180.0, 0.0)],
)
def test_roll_is_right_side_down_and_pitch_is_nose_up(
    turned: tuple[float, float, float], roll_deg: float, pitch_deg: float
) -> None:
    off = _pairs(np.array([1.0, 0.0, 0.0, 0.0]), quat_from_rotation_vector(np.array(turned)))
    assert abs(math.degrees(off.roll_rad)) == pytest.approx(abs(roll_deg), abs=0.1)
    assert math.degrees(off.pitch_rad) == pytest.approx(pitch_deg, abs=0.1)


def test_angles_around_half_a_turn_do_not_average_to_none() -> None:
    mocap = np.tile(quat_from_yaw(0.0), (2, 1))
    off = apart(mocap, np.stack((quat_from_yaw(3.13), quat_from_yaw(-3.13))))
    assert abs(off.heading_rad) > 3.0


@pytest.mark.parametrize(
    ("off", "words"),
    [
        (Difference(0.0, 0.0, math.radians(88.0)), "as if the frames were turned by 90 degrees"),
        (Difference(0.0, 0.0, math.radians(-95.0)), "as if the frames were turned by -90 degrees"),
        (Difference(0.0, 0.0, math.radians(179.0)), "as if the frames were turned by 180 degrees"),
    ],
)
def test_a_heading_off_by_a_quarter_is_told_so(off: Difference, words: str) -> None:
    assert words in check_heading(off, 0.1).todo


def test_a_body_upside_down_is_told_so() -> None:
    roll, pitch = check_tilts(Difference(math.pi, 0.01, 0.0), 0.05)
    assert not roll.passed
    assert "turned by 180 degrees about its x axis" in roll.todo
    assert pitch.passed


@dataclass(frozen=True)
class Torn:
    """Hovers in the middle, and is nowhere at 1 s."""

    duration_s: float = 2.0

    def at(self, time_s: float) -> Reference:
        place = np.full(3, math.nan) if time_s == 1.0 else np.array([0.0, 0.0, 1.2])
        return Reference(place, np.zeros(3), np.zeros(3), 0.0)


def test_a_trajectory_that_is_no_number_somewhere_is_not_inside() -> None:
    check = check_all(ready(), CONFIG, WANTED, RECOMMENDED, Torn())[-2]
    assert check.name == "fence around the trajectory"
    assert check.refuses
    assert "at 1.0 s" in check.todo
    with pytest.raises(ConfigError, match=r"leaves the room: x = nan m at 1\.00 s"):
        check_trajectory(Torn(), CONFIG.room, "torn")


def test_the_way_to_a_warning_is_told_only_while_it_is_none() -> None:
    slow = replace(ready(), machine=replace(MACHINE, realtime_priority=0))
    for realtime in (True, False):
        (check,) = failed(slow, PreflightConfig(realtime=realtime))
        assert check.must is realtime
        assert ("realtime = false" in check.todo) is realtime
