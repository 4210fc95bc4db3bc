"""Effects of the autopilot's faults on the vehicle and on its messages."""

import numpy as np
import pytest

from mock_autopilot.faults.sentences import parse
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.px4.vocabulary import Mode, Result
from tests.mock_autopilot.bench import NO_GPS, SIH_PLANT, Bench

HOVER = 0.5
PX4_LANDS = {"COM_OBL_RC_ACT": 4.0}


@pytest.fixture(scope="module")
def hovering() -> Bench:
    """In OFFBOARD at about 3 m with vision, level; copy it with `again`."""
    bench = Bench(NO_GPS | PX4_LANDS, plant=SIH_PLANT)
    bench.vision = True
    bench.run(5.0)
    bench.fly_offboard(3.0, HOVER)
    bench.run(1.0)
    assert bench.world.vehicle.mode is Mode.OFFBOARD
    return bench


def _with(bench: Bench, sentence: str, for_s: float) -> Bench:
    bench = bench.again()
    bench.world.inject(parse(sentence))
    bench.run(for_s)
    return bench


def _height_m(bench: Bench) -> float:
    return -float(bench.world.truth.position_ned_m[2])


def _roll_rad(q_wxyz: np.ndarray) -> float:
    return float(quat.to_euler(q_wxyz)[0])


def test_without_power_the_motors_stop_and_nothing_is_said_or_heard(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot off", 0.5)
    assert bench.sent[-1].time_s <= hovering.now_s
    assert float(bench.world.truth.velocity_ned_mps[2]) > 2.0, "it falls"
    assert bench.command(400, 1.0) == []
    bench.run(3.0)
    assert _height_m(bench) == pytest.approx(0.0, abs=1e-6)


def test_a_rebooted_autopilot_starts_again(hovering: Bench) -> None:
    asked = hovering.again()
    assert asked.command(511, 436, 50_000) == [0]
    bench = _with(asked, "autopilot wrong (reboot)", 6.0)
    back_s = asked.now_s + 3.0
    said = [sent for sent in bench.sent if sent.time_s > asked.now_s + 0.01]
    assert said[0].time_s == pytest.approx(back_s, abs=0.02)
    beats = bench.all("HEARTBEAT", back_s)
    assert beats[0].time_s == pytest.approx(back_s + 1.0, abs=0.02), "the first second it boots"
    assert not beats[0].message.base_mode & 128
    boot_s = bench.all("ATTITUDE", back_s)[0].message.time_boot_ms / 1e3
    assert boot_s == pytest.approx(1.0, abs=0.02), "its clock was reset"
    assert len(bench.all("CURRENT_MODE", back_s)) <= 2, "what was asked of it is forgotten"
    assert bench.world.vehicle.mode is Mode.HOLD
    assert bench.command(400, 0.0) == [Result.ACCEPTED], "it answers again"


def test_a_hung_autopilot_is_silent_keeps_its_thrust_and_tips_over(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot stuck for 1 s", 0.9)
    assert bench.sent[-1].time_s <= hovering.now_s
    assert float(bench.world.state.thrust_n) == pytest.approx(float(hovering.world.state.thrust_n), rel=0.02)
    assert abs(_roll_rad(bench.world.truth.q_ned_frd_wxyz)) > 0.4
    bench.run(0.6)
    assert bench.all("ATTITUDE", hovering.now_s + 0.95), "it goes on when it is over"


def test_it_disarms_in_the_air(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (disarms)", 1.1)
    assert not bench.all("HEARTBEAT", hovering.now_s)[-1].message.base_mode & 128
    assert bench.text_after("Disarmed by kill switch", hovering.now_s) < 0.1


def test_a_pilot_who_takes_over_holds_the_place_in_position_mode(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (pilot takes over)", 3.0)
    before_m = bench.world.truth.position_ned_m
    bench.run(5.0)
    assert bench.heartbeat()[:2] == (1 | 16 | 64 | 128, 3 << 16), "armed, manual input, POSCTL"
    shown = bench.all("CURRENT_MODE", hovering.now_s + 2.1)[-1].message
    assert shown.custom_mode == shown.intended_custom_mode == 3 << 16
    assert np.linalg.norm(bench.world.truth.position_ned_m - before_m) < 0.1, "our setpoints go on and do nothing"
    assert bench.mode(6)[-1] == Result.ACCEPTED, "back by command"
    assert bench.world.vehicle.mode is Mode.OFFBOARD


def test_without_the_fault_there_is_no_pilot_to_fly_it(hovering: Bench) -> None:
    bench = hovering.again()
    assert bench.mode(3)[-1] == Result.TEMPORARILY_REJECTED


def test_it_refuses_offboard(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (pilot takes over)", 0.1)
    bench.world.inject(parse("autopilot wrong (refuses offboard) for 1 s"))
    assert bench.mode(6)[-1] == Result.TEMPORARILY_REJECTED
    assert bench.text_after("Switching to Offboard is currently not available", hovering.now_s) < 1.0
    bench.run(1.0)
    assert bench.mode(6)[-1] == Result.ACCEPTED


def test_it_refuses_to_land_but_its_failsafe_does(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (refuses to land)", 0.1)
    assert bench.command(21) == [Result.TEMPORARILY_REJECTED]
    assert bench.mode(4, 6)[-1] == Result.TEMPORARILY_REJECTED
    assert bench.world.vehicle.mode is Mode.OFFBOARD
    bench.setpoint = None
    bench.run(1.2)
    assert bench.heartbeat()[1] == Mode.LAND.custom_mode


def test_it_ignores_setpoints_and_stays_in_offboard(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (ignores setpoints) for 2 s", 0.1)
    tilted = tuple(quat.from_rotation_vector(np.array([0.2, 0.0, 0.0])).tolist())
    bench.target(HOVER, tilted)
    bench.run(1.5)
    assert abs(_roll_rad(bench.world.truth.q_ned_frd_wxyz)) < 0.01
    assert bench.world.vehicle.mode is Mode.OFFBOARD
    bench.run(1.5)
    assert _roll_rad(bench.world.truth.q_ned_frd_wxyz) == pytest.approx(0.2, abs=0.02)


def test_a_wrong_horizon_is_believed_and_flown(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (attitude off) by 0.3 rad", 2.0)
    assert _roll_rad(bench.world.truth.q_ned_frd_wxyz) == pytest.approx(-0.3, abs=0.02)
    assert bench.all("ATTITUDE")[-1].message.roll == pytest.approx(0.0, abs=0.02), "it believes to be level"


def test_a_wrong_heading_is_believed_whatever_vision_says(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (heading off) by 0.5 rad", 4.0)
    assert quat.yaw_of(bench.world.truth.q_ned_frd_wxyz) == pytest.approx(-0.5, abs=0.02)
    assert bench.all("ATTITUDE")[-1].message.yaw == pytest.approx(0.0, abs=0.02)


def test_a_motor_pulls_it_askew_until_the_integral_has_it(hovering: Bench) -> None:
    bench = hovering.again()
    bench.world.inject(parse("autopilot wrong (motor) by 0.8 rad"))
    rolls = []
    for _ in range(40):
        bench.run(0.1)
        rolls.append(_roll_rad(bench.world.truth.q_ned_frd_wxyz))
    assert 0.4 < max(rolls) < 0.8
    assert abs(rolls[-1]) < 0.02
    reported = [abs(sent.message.roll) for sent in bench.all("ATTITUDE", hovering.now_s)]
    assert max(reported) == pytest.approx(max(rolls), abs=0.03), "it says so"


@pytest.mark.parametrize(("sentence", "percent"), [("(battery low)", 20), ("(battery critical) to 0.05", 5)])
def test_the_battery_is_suddenly_weaker_and_drains_on(hovering: Bench, sentence: str, percent: int) -> None:
    words = f"autopilot wrong {sentence}"
    bench = _with(hovering, words, 0.5)
    assert bench.all("SYS_STATUS")[-1].message.battery_remaining == pytest.approx(percent, abs=1)
    assert bench.world.vehicle.battery.charge <= parse(words).magnitude


def test_weak_motors_lift_less_while_it_lasts(hovering: Bench) -> None:
    bench = _with(hovering, "autopilot wrong (weak) to 0.6 for 0.5 s", 0.45)
    assert float(bench.world.state.thrust_n) == pytest.approx(0.6 * float(hovering.world.state.thrust_n), rel=0.02)
    bench.run(0.6)
    assert float(bench.world.state.thrust_n) == pytest.approx(float(hovering.world.state.thrust_n), rel=0.02)


def test_the_same_seed_and_faults_give_the_same_flight_and_chance_has_no_say_elsewhere() -> None:
    def flown(seed: int, *faults: str) -> bytes:
        bench = Bench(seed=seed, faults=faults)  # with GPS, whose error is random
        bench.run(4.0)
        bench.command(22)
        bench.arm()
        bench.run(4.0)
        return bench.world.truth.position_ned_m.tobytes()

    assert flown(1) == flown(1, "link intermittent by 0.9 at 60 s", "mocap garbage") != flown(2)
    lossy = "link intermittent (to the autopilot) by 0.5 in the air after 1 s"
    assert flown(3, lossy) == flown(3, lossy)
