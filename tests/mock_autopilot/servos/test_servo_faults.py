"""Every fault of the servos, in simulated time, without a port."""

import pytest

from mock_autopilot.servos.config import Fault, FaultKind
from mock_autopilot.servos.packets import Error1, Instruction, Packet
from mock_autopilot.servos.rack import ServoRack
from mock_autopilot.servos.servo import Servo
from tests.mock_autopilot.servos.servo_rig import AX, CONFIG, XM, pings, read, run, write


@pytest.fixture
def rack() -> ServoRack:
    return ServoRack(CONFIG)


@pytest.fixture
def xm(rack: ServoRack) -> Servo:
    return rack.servo(XM)


@pytest.fixture
def ax(rack: ServoRack) -> Servo:
    return rack.servo(AX)


@pytest.mark.parametrize("servo_id", [XM, AX])
def test_a_missing_servo_is_silent_while_the_fault_lasts_and_goes_on_moving(servo_id: int) -> None:
    fault = Fault(kind=FaultKind.MISSING, id=servo_id, at_s=0.5, for_s=0.5)
    rack = ServoRack(CONFIG.model_copy(update={"faults": (fault,)}))
    write(rack.servo(servo_id), "torque_enable", 1)
    write(rack.servo(servo_id), "goal_position", 700)
    heard = []
    for _ in range(15):
        run(rack, 0.1)
        heard.append(pings(rack, servo_id))
    assert heard == [1] * 4 + [0] * 5 + [1] * 6
    other = XM + AX - servo_id
    assert pings(rack, other) == 1
    assert read(rack.servo(servo_id), "present_position") == pytest.approx(700, abs=4)


def test_answers_come_late_by_the_fault_s_delay(rack: ServoRack) -> None:
    rack.inject(Fault(kind=FaultKind.LATE, id=AX, late_s=0.07))
    [late] = rack.answer(Packet(1, AX, Instruction.PING, b""))
    [prompt] = rack.answer(Packet(2, XM, Instruction.PING, b""))
    assert (late.late_s, prompt.late_s) == (0.07, 0.0)


def test_every_second_answer_is_corrupt_in_one_byte_when_asked_for(rack: ServoRack) -> None:
    clean = rack.answer(Packet(2, XM, Instruction.PING, b""))[0].data
    rack.inject(Fault(kind=FaultKind.CORRUPT, id=XM, every=2))
    wrong = []
    for _ in range(6):
        [said] = rack.answer(Packet(2, XM, Instruction.PING, b""))
        wrong.append([i for i, (a, b) in enumerate(zip(said.data, clean, strict=True)) if a != b])
    assert [len(places) for places in wrong] == [0, 1, 0, 1, 0, 1]
    assert len({places[0] for places in wrong if places}) == 3


def test_an_overload_from_outside_is_latched_at_once_and_again_after_a_restart(rack: ServoRack, xm: Servo) -> None:
    write(xm, "torque_enable", 1)
    rack.inject(Fault(kind=FaultKind.OVERLOAD, id=XM, for_s=2.0))
    assert (xm.torque_on, read(xm, "hardware_error_status")) == (False, 0x20)
    xm.restart(rack.time_s)
    run(rack, 0.6)
    assert read(xm, "hardware_error_status") == 0
    write(xm, "torque_enable", 1)
    run(rack, 0.02)
    assert (xm.torque_on, read(xm, "hardware_error_status")) == (False, 0x20)
    run(rack, 2.0)
    xm.restart(rack.time_s)
    run(rack, 0.6)
    write(xm, "torque_enable", 1)
    run(rack, 0.1)
    assert (xm.torque_on, read(xm, "hardware_error_status")) == (True, 0)


def test_low_voltage_shows_in_both_kinds_and_goes_with_its_cause(rack: ServoRack, xm: Servo, ax: Servo) -> None:
    write(xm, "torque_enable", 1)
    rack.inject(Fault(kind=FaultKind.VOLTAGE, volts_v=5.5, for_s=1.0))
    assert (read(xm, "present_input_voltage"), read(ax, "present_voltage")) == (55, 55)
    assert (read(xm, "hardware_error_status"), xm.torque_on) == (0x01, True)
    assert ax.error == Error1.INPUT_VOLTAGE
    run(rack, 1.1)
    assert (read(xm, "present_input_voltage"), read(xm, "hardware_error_status"), ax.error) == (120, 0, 0)


def test_a_voltage_error_among_those_that_shut_down_is_latched(rack: ServoRack, xm: Servo) -> None:
    write(xm, "shutdown", 0x35)
    write(xm, "torque_enable", 1)
    rack.inject(Fault(kind=FaultKind.VOLTAGE, id=XM, volts_v=9.4, for_s=0.5))
    run(rack, 1.0)
    assert (read(xm, "hardware_error_status"), xm.torque_on) == (0x01, False)


def test_heat_shuts_both_kinds_down(rack: ServoRack, xm: Servo, ax: Servo) -> None:
    write(xm, "torque_enable", 1)
    write(ax, "torque_enable", 1)
    rack.inject(Fault(kind=FaultKind.HOT, for_s=0.5))
    assert (read(xm, "present_temperature"), read(ax, "present_temperature")) == (85, 75)
    assert (read(xm, "hardware_error_status"), xm.torque_on) == (0x04, False)
    assert (ax.error, read(ax, "torque_limit")) == (Error1.OVERHEATING, 0)
    run(rack, 0.6)
    assert (read(xm, "hardware_error_status"), ax.error, read(ax, "torque_limit")) == (0x04, 0, 0)


def test_a_restarted_servo_is_silent_then_limp_and_has_forgotten_its_ram(rack: ServoRack, xm: Servo) -> None:
    write(xm, "return_delay_time", 7)
    write(xm, "profile_velocity", 50)
    write(xm, "torque_enable", 1)
    write(xm, "goal_position", 3000)
    run(rack, 0.5)
    rack.inject(Fault(kind=FaultKind.REBOOT, id=XM, at_s=0.1))
    heard = []
    for _ in range(8):
        run(rack, 0.1)
        heard.append(pings(rack, XM))
    assert heard == [0] * 5 + [1] * 3
    assert not xm.torque_on
    assert (read(xm, "profile_velocity"), read(xm, "return_delay_time")) == (0, 7)
    assert 2048 < read(xm, "present_position") < 2500
    assert abs(read(xm, "goal_position") - read(xm, "present_position")) < 60


def test_a_restart_happens_once_for_each_fault(rack: ServoRack, ax: Servo) -> None:
    rack.inject(Fault(kind=FaultKind.REBOOT, id=AX))
    run(rack, 0.6)
    write(ax, "torque_enable", 1)
    rack.inject(Fault(kind=FaultKind.MISSING, id=XM))
    run(rack, 0.6)
    assert ax.torque_on


def test_a_silent_bus_answers_nothing_and_keeps_its_torque(rack: ServoRack, xm: Servo) -> None:
    write(xm, "torque_enable", 1)
    rack.inject(Fault(kind=FaultKind.SILENT_BUS, for_s=0.3))
    assert (pings(rack, XM), pings(rack, AX)) == (0, 0)
    run(rack, 0.4)
    assert (pings(rack, XM), pings(rack, AX), xm.torque_on) == (1, 1, True)


def test_clearing_ends_the_faults_meant_and_no_others(rack: ServoRack) -> None:
    rack.inject(Fault(kind=FaultKind.MISSING, id=XM))
    rack.inject(Fault(kind=FaultKind.MISSING, id=AX))
    rack.clear(FaultKind.LATE)
    assert (pings(rack, XM), pings(rack, AX)) == (0, 0)
    rack.clear(FaultKind.MISSING, AX)
    assert (pings(rack, XM), pings(rack, AX)) == (0, 1)
    rack.clear()
    assert (pings(rack, XM), pings(rack, AX)) == (1, 1)


def test_a_fault_of_a_servo_that_is_not_there_is_refused(rack: ServoRack) -> None:
    with pytest.raises(ValueError, match=r"fault missing cannot have id 9: there are \[1, 2\]"):
        rack.inject(Fault(kind=FaultKind.MISSING, id=9))


def test_a_servo_at_another_baud_rate_does_not_understand(rack: ServoRack, xm: Servo) -> None:
    ping = Packet(2, XM, Instruction.PING, b"")
    assert (len(rack.answer(ping, 1_000_000)), len(rack.answer(ping, 57_600))) == (1, 0)
    write(xm, "baud_rate", 1)
    assert (len(rack.answer(ping, 1_000_000)), len(rack.answer(ping, 57_600))) == (0, 1)
