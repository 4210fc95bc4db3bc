"""Every fault of the simulated bus: what is latched, what goes on, and how it is cleared."""

import asyncio
import logging
import threading
from pathlib import Path

import numpy as np
import pytest

from companion.adapters.dynamixel.bus_thread import THREAD_NAME
from companion.core.interfaces import ArmError
from companion.core.types import ArmFaultKind
from mock_autopilot.servos.config import FaultKind
from tests.adapters.dynamixel.rig import CLOCK, connected, cycles, fault_of, kinds, mock_bus, place, until

pytestmark = pytest.mark.realtime

SOUND_RAD = 0.02
"""Nearer than this is there."""


async def test_a_missing_servo_is_latched_by_name_and_the_others_are_read_and_driven_on() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.MISSING, 2)
        fault = await fault_of(bus, "right.elbow_pitch")
        assert fault.kind is ArmFaultKind.SILENT
        assert "right.elbow_pitch (ID 2) has not answered" in fault.text
        assert "clear the faults" in fault.text
        bus.move(np.full(8, 0.5))
        await until(lambda: abs(np.delete(rig.joints_rad, 1) - 0.5).max() < SOUND_RAD)
        assert abs(rig.joints_rad[1]) < SOUND_RAD
        read_s = bus.status().read_s
        await cycles(bus, 3)
        assert (np.delete(bus.status().read_s - read_s, 1) > 0.0).all()
        assert kinds(bus) == {("right.elbow_pitch", ArmFaultKind.SILENT)}


async def test_a_missing_servo_costs_the_others_no_cycle_once_it_is_known() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        rig.fault(FaultKind.MISSING, 2)
        await fault_of(bus, "right.elbow_pitch")
        await cycles(bus, 2)
        rig.packets.clear()
        asked_s = CLOCK.now_s()
        await cycles(bus, 40)
        asked = sum(packet.id == 2 for packet in rig.packets)
        assert asked <= (CLOCK.now_s() - asked_s) / 0.5 + 1


async def test_a_claw_that_is_missing_is_latched_too() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        rig.fault(FaultKind.MISSING, 8)
        assert (await fault_of(bus, "left.claw")).kind is ArmFaultKind.SILENT
        read_s = bus.status().read_s
        await cycles(bus, 4)
        assert (bus.status().read_s - read_s > 0.0).sum() == 7


async def test_half_the_bus_missing_does_not_blind_the_other_half() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        for servo_id in (5, 6, 7, 8):
            rig.fault(FaultKind.MISSING, servo_id)
        await until(lambda: len(bus.status().faults) == 4)
        read_s = bus.status().read_s
        await cycles(bus, 4)
        assert ((bus.status().read_s - read_s)[:4] > 0.0).all()
        assert {joint for joint, _ in kinds(bus)} == {
            "left.shoulder_pitch", "left.elbow_pitch", "left.elbow_roll", "left.claw",
        }  # fmt: skip


async def test_a_servo_that_comes_back_is_read_again_but_stays_latched_and_gets_no_goals_until_cleared() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.MISSING, 2)
        await fault_of(bus, "right.elbow_pitch")
        rig.bus.clear()
        gone_s = bus.status().read_s[1]
        await until(lambda: bus.status().read_s[1] > gone_s)
        assert np.isnan(bus.status().held_rad).tolist() == [number == 1 for number in range(8)]
        rig.packets.clear()
        bus.move(np.full(8, 0.3))
        await until(lambda: rig.goals_sent(1))
        assert rig.goals_sent(2) == []
        assert kinds(bus) == {("right.elbow_pitch", ArmFaultKind.SILENT)}
        await bus.clear_faults()
        assert bus.status().faults == ()
        assert np.isnan(bus.status().held_rad[1])
        await bus.torque_on()
        assert np.isfinite(bus.status().held_rad).all()
        bus.move(np.full(8, 0.3))
        await until(lambda: abs(rig.joints_rad - 0.3).max() < SOUND_RAD)


async def test_a_short_absence_is_no_fault() -> None:
    async with mock_bus() as rig, connected(rig, silent_s=2.0) as bus:
        rig.fault(FaultKind.MISSING, 2)
        await until(lambda: bus.status().bad_packets >= 3)
        rig.bus.clear()
        read_s = bus.status().read_s[1]
        await until(lambda: bus.status().read_s[1] > read_s)
        assert bus.status().faults == ()


async def test_broken_answers_now_and_then_are_counted_and_asked_for_again() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.CORRUPT, every=7)
        bus.move(np.full(8, 0.4))
        await until(lambda: abs(rig.joints_rad - 0.4).max() < SOUND_RAD)
        await cycles(bus, 20)
        assert bus.status().bad_packets > 10
        assert bus.status().faults == ()
        assert bus.status().position_rad == pytest.approx(rig.joints_rad, abs=SOUND_RAD)


async def test_answers_that_come_late_are_counted_and_trouble_nobody_else() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.LATE, 3, late_s=0.05)
        bus.move(np.full(8, 0.3))
        others = np.arange(8) != place("right.elbow_roll")
        await until(lambda: abs(rig.joints_rad[others] - 0.3).max() < SOUND_RAD)
        read_s = bus.status().read_s
        await cycles(bus, 4)
        assert (bus.status().read_s - read_s > 0.0)[others].all()
        assert bus.status().bad_packets > 10
        assert kinds(bus) <= {("right.elbow_roll", ArmFaultKind.SILENT)}


@pytest.mark.parametrize(
    ("servo_id", "joint", "fault", "kind", "words"),
    [
        (6, "left.elbow_pitch", FaultKind.OVERLOAD, ArmFaultKind.OVERLOAD, "is overloaded and has no torque"),
        (4, "right.claw", FaultKind.OVERLOAD, ArmFaultKind.OVERLOAD, "is overloaded and has no torque"),
        (8, "left.claw", FaultKind.HOT, ArmFaultKind.HARDWARE, "reports overheating and has no torque"),
        (
            2,
            "right.elbow_pitch",
            FaultKind.VOLTAGE,
            ArmFaultKind.HARDWARE,
            "input voltage out of range and still holds",
        ),
    ],
)
async def test_what_a_servo_reports_is_latched_alone_and_cleared_on_command(
    servo_id: int, joint: str, fault: FaultKind, kind: ArmFaultKind, words: str
) -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(fault, servo_id)
        said = await fault_of(bus, joint)
        assert (said.kind, words in said.text) == (kind, True), said.text
        bus.move(np.full(8, 0.3))
        others = np.arange(8) != place(joint)
        await until(lambda: abs(rig.joints_rad[others] - 0.3).max() < SOUND_RAD)
        rig.bus.clear()
        await cycles(bus, 20)
        assert kinds(bus) == {(joint, kind)}
        await bus.clear_faults()
        assert bus.status().faults == ()
        await bus.torque_on()
        bus.move(np.full(8, 0.2))
        await until(lambda: abs(rig.joints_rad - 0.2).max() < SOUND_RAD)


async def test_a_fault_whose_cause_remains_cannot_be_cleared() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.HOT, 1)
        rig.fault(FaultKind.HOT, 4)
        rig.fault(FaultKind.MISSING, 2)
        await until(lambda: len(bus.status().faults) == 3)
        with pytest.raises(ArmError) as caught:
            await bus.clear_faults()
        assert "right.shoulder_pitch (ID 1) still reports overheating" in str(caught.value)
        assert "right.claw (ID 4) still reports overheating" in str(caught.value)
        assert "right.elbow_pitch (ID 2) does not answer" in str(caught.value)
        assert {joint for joint, _ in kinds(bus)} == {"right.shoulder_pitch", "right.claw", "right.elbow_pitch"}


async def test_torque_stays_off_while_a_fault_is_latched() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        rig.fault(FaultKind.MISSING, 2)
        await fault_of(bus, "right.elbow_pitch")
        with pytest.raises(ArmError, match=r"while faults are latched:\n  right\.elbow_pitch \(ID 2\)"):
            await bus.torque_on()
        assert not any(servo.torque_on for servo in rig.bus.servos.servos)


@pytest.mark.parametrize(("servo_id", "joint"), [(5, "left.shoulder_pitch"), (8, "left.claw")])
async def test_a_reboot_is_noticed_however_short_and_not_repaired(servo_id: int, joint: str) -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(np.full(8, 0.2))
        await cycles(bus, 5)
        servo = rig.servo(servo_id)
        servo.restart(rig.bus.servos.time_s)
        servo.restarts_until_s = 0.0  # back at once: a glitch in its supply
        assert (await fault_of(bus, joint)).kind is ArmFaultKind.REBOOTED
        rig.packets.clear()
        await cycles(bus, 20)
        assert rig.goals_sent(servo_id) == []
        assert rig.goals_sent(1)
        await bus.clear_faults()
        await bus.torque_on()
        assert all(servo.torque_on for servo in rig.bus.servos.servos)


async def test_a_slow_reboot_is_a_servo_that_has_gone_silent() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.REBOOT, 5)
        assert (await fault_of(bus, "left.shoulder_pitch")).kind is ArmFaultKind.SILENT
        await until(lambda: not bus.status().torque_on[4])
        assert not rig.servo(5).torque_on


async def test_healthy_joints_move_on_while_another_reboots_to_clear_its_fault() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.OVERLOAD, 6)
        await fault_of(bus, "left.elbow_pitch")
        rig.bus.clear()
        clearing = asyncio.create_task(bus.clear_faults())
        begun = bus.status().cycles
        bus.move(np.full(8, 0.15))
        await until(lambda: abs(rig.joints_rad[0] - 0.15) < SOUND_RAD)
        assert not clearing.done()
        assert bus.status().cycles > begun + 5
        await clearing
        assert bus.status().faults == ()


async def test_a_silent_bus_is_every_joint_silent_and_can_be_cleared_when_it_speaks_again() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        rig.fault(FaultKind.SILENT_BUS)
        await until(lambda: len(bus.status().faults) == 8)
        assert {kind for _, kind in kinds(bus)} == {ArmFaultKind.SILENT}
        rig.bus.clear()
        await bus.clear_faults()
        await bus.torque_on()
        assert bus.status().faults == ()
        assert (rig.strayed_rad < SOUND_RAD).all()


async def test_a_port_that_goes_away_is_one_fault_and_is_opened_again_only_on_command(rig_link: str) -> None:
    async with mock_bus(link=rig_link) as rig, connected(rig) as bus:
        await bus.torque_on()
        last_rad = bus.status().position_rad
        rig.fault(FaultKind.PORT_GONE)
        fault = await fault_of(bus, "bus")
        assert fault.kind is ArmFaultKind.BUS
        assert f"the arms' port {rig_link} is gone" in fault.text
        assert "plug its cable in again" in fault.text
        assert bus.status().position_rad == pytest.approx(last_rad, abs=SOUND_RAD)
        with pytest.raises(ArmError, match="no serial port"):
            await bus.clear_faults()
        with pytest.raises(ArmError, match="is gone"):
            await bus.torque_off()
        rig.bus.clear()
        done = bus.status().cycles
        await asyncio.sleep(0.05)
        assert bus.status().cycles == done
        await bus.clear_faults()
        assert bus.status().faults == ()
        assert bus.status().torque_on.all()
        await bus.torque_on()
        await cycles(bus, 10)
        assert (rig.strayed_rad < SOUND_RAD).all()


async def test_closing_while_the_port_is_gone_ends_the_thread(rig_link: str) -> None:
    async with mock_bus(link=rig_link) as rig:
        async with connected(rig) as bus:
            rig.fault(FaultKind.PORT_GONE)
            await fault_of(bus, "bus")
        assert THREAD_NAME not in {thread.name for thread in threading.enumerate()}


async def test_an_unexpected_failure_of_the_worker_is_a_fault_with_its_text(caplog: pytest.LogCaptureFixture) -> None:
    async with mock_bus() as rig, connected(rig) as bus:

        def broken() -> None:
            raise ZeroDivisionError("made up")

        bus._bus_thread._obey = broken  # type: ignore[method-assign]
        with caplog.at_level(logging.ERROR):
            fault = await fault_of(bus, "bus")
        assert fault.kind is ArmFaultKind.BUS
        assert "ZeroDivisionError('made up')" in fault.text
        assert "Traceback" in caplog.text
        del bus._bus_thread._obey
        await bus.clear_faults()
        await cycles(bus, 5)
        assert bus.status().faults == ()


@pytest.fixture
def rig_link(tmp_path: Path) -> str:
    return f"{tmp_path}/arms"
