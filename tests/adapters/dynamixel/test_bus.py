"""The driver over a pty against simulated servos: connecting, moving, torque on and off, closing."""

import threading
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from companion.adapters.dynamixel.bus_thread import THREAD_NAME
from companion.arms.model import ArmModel
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError
from mock_autopilot.servos.packets import Instruction
from tests.adapters.dynamixel.rig import BusRig, connected, cycles, mock_bus, until

pytestmark = pytest.mark.realtime

TICK_RAD = 2.0 * np.pi / 4096.0
AX_TICK_RAD = np.radians(300.0 / 1023.0)
TICKS_RAD = np.array([TICK_RAD] * 3 + [AX_TICK_RAD] + [TICK_RAD] * 3 + [AX_TICK_RAD])
REACH_RAD = np.array([0.4, 0.6, -0.2, 0.5, 0.3, 0.5, 0.1, 0.7])
LIMITS = ArmModel().limit_arrays()


def worker_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == THREAD_NAME]


def eeprom(rig: BusRig) -> list[bytes]:
    return [bytes(servo.table.bytes[: 24 if servo.model.protocol == 1 else 64]) for servo in rig.bus.servos.servos]


def at(rig: BusRig, goal_rad: np.ndarray) -> bool:
    """Return True when every joint is at its goal within two ticks and the AX's compliance margin."""
    return bool((abs(rig.joints_rad - goal_rad) < 3.0 * TICKS_RAD).all())


async def test_connecting_reads_every_joint_and_changes_nothing() -> None:
    async with mock_bus() as rig:
        before = eeprom(rig)
        async with connected(rig) as bus:
            status = bus.status()
            assert np.isfinite(status.read_s).all()
            assert abs(status.position_rad - rig.joints_rad) == pytest.approx(np.zeros(8), abs=max(TICKS_RAD))
            assert status.voltage_v == pytest.approx(np.full(8, 12.0), abs=0.06)
            assert not status.torque_on.any()
            assert status.faults == ()
        writing = {Instruction.WRITE, Instruction.SYNC_WRITE, Instruction.REG_WRITE, Instruction.REBOOT}
        assert not any(packet.code in writing for packet in rig.packets)
        assert eeprom(rig) == before


async def test_every_joint_goes_where_it_is_told() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(REACH_RAD)
        await until(lambda: at(rig, REACH_RAD))
        await cycles(bus, 3)
        assert bus.status().position_rad == pytest.approx(rig.joints_rad, abs=max(TICKS_RAD))
        assert bus.status().faults == ()


async def test_joints_that_are_mounted_the_other_way_round_move_the_other_way() -> None:
    turned = {name: servo.model_dump() for name, servo in ArmsConfig().servos.items()}
    turned["left.shoulder_pitch"] |= {"direction": -1, "zero_rad": 3.0}
    async with mock_bus() as rig, connected(rig, servos=turned) as bus:
        await bus.torque_on()
        bus.move(REACH_RAD)
        await until(lambda: abs(rig.servo(5).motor.angle_rad - (3.0 - 0.3)) < 3 * TICK_RAD)
        await until(lambda: abs(bus.status().position_rad[4] - 0.3) < 3 * TICK_RAD)


async def test_goals_travel_in_one_sync_write_for_each_protocol() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(np.array([0.0, 0.0, 0.0, 0.1] * 2))
        rig.packets.clear()
        await cycles(bus, 20)
        assert not any(packet.code == Instruction.WRITE for packet in rig.packets)
        writes = [packet for packet in rig.packets if packet.code == Instruction.SYNC_WRITE]
        assert all(one.protocol != other.protocol for one, other in pairwise(writes))
        xm, ax = writes[-2:] if writes[-1].protocol == 1 else writes[-3:-1]
        goals = [bytes([servo_id]) + (2048).to_bytes(4, "little") for servo_id in (1, 2, 3, 5, 6, 7)]
        assert xm.params == bytes.fromhex("74 00 04 00") + b"".join(goals)
        assert ax.params == bytes.fromhex("1e 02  04 13 02  08 13 02")


async def test_the_latest_goal_wins_and_nothing_queues() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.packets.clear()
        for number in range(200):
            bus.move(np.full(8, 0.001 * (number % 100)))
        bus.move(np.full(8, 0.05))
        wanted = round((np.pi + 0.05) / TICK_RAD)
        await until(lambda: rig.goals_sent(1)[-1:] == [wanted])
        assert len(rig.goals_sent(1)) < 50


async def test_torque_on_moves_nothing_although_a_far_goal_was_left_in_the_servos() -> None:
    async with mock_bus() as rig:
        for servo in rig.bus.servos.servos:
            servo.table.put("goal_position", 300)
        async with connected(rig) as bus:
            await bus.torque_on()
            await cycles(bus, 25)
            assert bus.status().torque_on.all()
            assert (rig.strayed_rad < TICKS_RAD).all()


async def test_joints_that_are_held_already_keep_their_goals_so_that_loads_do_not_bend_them_further() -> None:
    async with mock_bus() as rig:
        async with connected(rig) as bus:
            await bus.torque_on()
            bus.move(REACH_RAD)
            await until(lambda: at(rig, REACH_RAD))
        rig.load_nm = (-0.4,) * 8
        async with connected(rig) as bus:
            await until(lambda: np.all((REACH_RAD - bus.status().position_rad)[:3] > 3.0 * TICK_RAD))
        goals = [servo.table.get("goal_position") for servo in rig.bus.servos.servos]
        async with connected(rig) as bus:
            await bus.torque_on()
            await cycles(bus, 10)
            assert bus.status().held_rad == pytest.approx(REACH_RAD, abs=max(TICKS_RAD))
        assert [servo.table.get("goal_position") for servo in rig.bus.servos.servos] == goals


async def test_a_goal_that_is_far_away_is_given_up_but_not_by_a_claw_which_grips() -> None:
    async with mock_bus() as rig:
        async with connected(rig) as bus:
            await bus.torque_on()
        for servo in (rig.servo(1), rig.servo(4)):
            servo.table.put("goal_position", servo.table.get("goal_position") + 200)
        async with connected(rig) as bus:
            assert np.isnan(bus.status().held_rad).all()
            await bus.torque_on()
            assert bus.status().held_rad[0] == pytest.approx(rig.joints_rad[0], abs=0.1)
            await until(lambda: abs(rig.joints_rad[3] - 200 * AX_TICK_RAD) < 3.0 * AX_TICK_RAD)
            assert rig.joints_rad[0] < 0.5 * 200 * TICK_RAD


async def test_a_goal_given_before_torque_on_is_never_sent() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        bus.move(REACH_RAD)
        await cycles(bus, 5)
        assert not any(packet.code == Instruction.SYNC_WRITE for packet in rig.packets)
        await bus.torque_on()
        await cycles(bus, 25)
        assert (rig.strayed_rad < TICKS_RAD).all()


async def test_a_wild_goal_is_approached_no_faster_than_the_joint_may_move() -> None:
    _, highest, fastest, _ = LIMITS
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(np.full(8, 100.0))
        await until(lambda: (highest - rig.joints_rad)[[0, 2, 3]].max() < 0.02)
        assert (rig.fastest_radps < 1.5 * fastest + 0.2).all()
        goals_rad = TICK_RAD * np.array(rig.goals_sent(1))
        assert abs(np.diff(goals_rad)).max() <= 1.2 * fastest[0] * 0.05 + TICK_RAD
        assert (rig.joints_rad < highest + 0.02).all()


async def test_nan_leaves_a_joint_where_it_is_going() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(np.where(np.arange(8) == 1, np.nan, REACH_RAD))
        await until(lambda: abs(rig.joints_rad[0] - REACH_RAD[0]) < 3 * TICK_RAD)
        assert abs(rig.joints_rad[1]) < 2 * TICK_RAD


async def test_goals_of_another_shape_are_refused() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        with pytest.raises(ValueError, match="shape"):
            bus.move(np.zeros(7))


async def test_torque_off_is_limp_and_stays_limp_although_goals_come() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(np.zeros(8))
        await cycles(bus, 5)
        await bus.torque_off()
        bus.move(REACH_RAD)
        await cycles(bus, 20)
        assert not any(servo.torque_on for servo in rig.bus.servos.servos)
        assert not bus.status().torque_on.any()
        assert bus.status().faults == ()


async def test_torque_can_be_switched_on_and_off_twice_and_again_when_it_is_on() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        for _ in range(2):
            await bus.torque_on()
            await bus.torque_on()
            assert all(servo.torque_on for servo in rig.bus.servos.servos)
            await bus.torque_off()
            assert not any(servo.torque_on for servo in rig.bus.servos.servos)


async def test_the_servos_own_profile_guards_against_jumps_too() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        xm, ax = rig.servo(1).table, rig.servo(4).table
        assert xm.get("profile_velocity") * 0.229 * 2 * np.pi / 60 == pytest.approx(1.5 * 3.0, abs=0.03)
        assert xm.get("profile_acceleration") * 214.577 * 2 * np.pi / 3600 == pytest.approx(3.0 * 20.0, abs=0.4)
        assert ax.get("moving_speed") * 0.111 * 2 * np.pi / 60 == pytest.approx(1.5 * 4.0, abs=0.02)


async def test_closing_ends_the_thread_and_leaves_the_torque_as_it_is() -> None:
    async with mock_bus() as rig:
        async with connected(rig) as bus:
            await bus.torque_on()
            assert len(worker_threads()) == 1
        assert worker_threads() == []
        assert all(servo.torque_on for servo in rig.bus.servos.servos)
        async with connected(rig) as bus:
            assert bus.status().torque_on.all()
            await bus.torque_on()
            await cycles(bus, 20)
            assert (rig.strayed_rad < TICKS_RAD).all()


async def test_the_port_is_ours_alone() -> None:
    async with mock_bus() as rig, connected(rig):
        with pytest.raises(ArmError, match="already in use by another process"):
            async with connected(rig):
                pass
    assert worker_threads() == []


async def test_a_servo_that_refuses_its_torque_is_named_and_the_others_hold() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        rig.servo(3).table.put("min_position_limit", 3000)
        with pytest.raises(ArmError, match=r"right\.elbow_roll \(ID 3\) refuses .* register 116"):
            await bus.torque_on()
        assert [servo.torque_on for servo in rig.bus.servos.servos] == [
            servo.id != 3 for servo in rig.bus.servos.servos
        ]


async def test_a_firmware_without_fast_sync_read_is_read_by_sync_read(caplog: pytest.LogCaptureFixture) -> None:
    async with mock_bus() as rig:
        answer = rig.bus.servos.answer
        rig.bus.servos.answer = (  # type: ignore[method-assign]
            lambda packet, baud=None: [] if packet.code == Instruction.FAST_SYNC_READ else answer(packet, baud)
        )
        async with connected(rig) as bus:
            await until(lambda: "from now on Sync Read" in caplog.text)
            await cycles(bus, 2)
            rig.packets.clear()
            await cycles(bus, 20)
            codes = {packet.code for packet in rig.packets}
            assert codes == {Instruction.SYNC_READ, Instruction.READ}
            assert bus.status().faults == ()


async def test_no_such_port(tmp_path: Path) -> None:
    async with mock_bus() as rig:
        with pytest.raises(ArmError, match=r"no serial port .*nowhere \(arms\.port\)"):
            async with connected(rig, port=str(tmp_path / "nowhere")):
                pass
    assert worker_threads() == []
