"""Answers of the servos, without a port: the manuals' examples byte for byte, errors, and silent servos."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind, ServoConfig
from mock_autopilot.servos.packets import ALERT, Error1, Error2, Instruction, Packet, Parser, pack1, pack2
from mock_autopilot.servos.rack import ServoRack
from tests.mock_autopilot.servos.dynamixel_examples import FAST_SYNC_READ_ANSWER, PROTOCOL_1, PROTOCOL_2, Example

PULSE_RAD = 6.283185307179586 / 4096


def xm(servo_id: int, pulses: int = 2048) -> ServoConfig:
    start_rad = pulses * PULSE_RAD
    return ServoConfig(id=servo_id, model="XM430-W210", start_position_rad=start_rad, firmware=38)


def rack(*servos: ServoConfig, voltage_v: float = 12.0) -> ServoRack:
    return ServoRack(DynamixelConfig(servos=servos, voltage_v=voltage_v))


def ax(servo_id: int) -> ServoConfig:
    return ServoConfig(id=servo_id, model="AX-12A")


def ask(servos: ServoRack, raw: bytes) -> list[bytes]:
    [packet] = Parser().feed(raw)
    return [said.data for said in servos.answer(packet)]


def ask2(servos: ServoRack, servo_id: int, instruction: int, *params: int) -> tuple[int, bytes]:
    """Error and data of the only answer."""
    [raw] = ask(servos, pack2(servo_id, instruction, bytes(params)))
    [packet] = Parser().feed(raw)
    assert (packet.id, packet.code) == (servo_id, Instruction.STATUS)
    return packet.params[0], packet.params[1:]


def ask1(servos: ServoRack, servo_id: int, instruction: int, *params: int) -> tuple[int, bytes]:
    [raw] = ask(servos, pack1(servo_id, instruction, bytes(params)))
    [packet] = Parser().feed(raw)
    assert packet.id == servo_id
    return packet.code, packet.params


def example(protocol: int, name: str) -> Example:
    return next(one for one in PROTOCOL_1 + PROTOCOL_2 if (one.protocol, one.name) == (protocol, name))


@pytest.mark.parametrize("name", ["ping", "broadcast ping", "read", "reboot", "clear", "sync read"])
def test_the_manual_s_xm_answers_are_given_byte_for_byte(name: str) -> None:
    servos = rack(*([xm(1, 166)] if name == "ping" else [xm(1, 166), xm(2, 2079)]))
    assert ask(servos, example(2, name).request_bytes) == example(2, name).answer_bytes


def test_the_manual_s_writes_are_confirmed_and_done() -> None:
    servos = rack(xm(1), xm(2))
    table = servos.servo(1).table
    assert ask(servos, example(2, "write").request_bytes) == example(2, "write").answer_bytes
    assert table.get("goal_position") == 512
    assert ask(servos, example(2, "reg write").request_bytes) == example(2, "reg write").answer_bytes
    assert (table.get("goal_velocity"), ask2(servos, 1, Instruction.READ, 69, 0, 1, 0)) == (0, (0, b"\1"))
    assert ask(servos, example(2, "action").request_bytes) == example(2, "action").answer_bytes
    assert (table.get("goal_velocity"), ask2(servos, 1, Instruction.READ, 69, 0, 1, 0)) == (200, (0, b"\0"))
    assert ask(servos, example(2, "sync write").request_bytes) == []
    assert [servos.servo(i).table.get("goal_position") for i in (1, 2)] == [150, 170]
    assert ask(servos, example(2, "bulk write").request_bytes) == []
    assert (table.get("max_voltage_limit"), servos.servo(2).table.get("temperature_limit")) == (160, 80)


def test_the_manual_s_bulk_read_is_answered_byte_for_byte() -> None:
    servos = rack(xm(1), xm(2), voltage_v=11.9)
    servos.servo(2).temperature_c = 36.0
    assert ask(servos, example(2, "bulk read").request_bytes) == example(2, "bulk read").answer_bytes


def test_the_manual_s_fast_sync_read_is_answered_in_one_packet_byte_for_byte() -> None:
    servos = rack(xm(3, 166), xm(4, 1023), xm(7, 2079))
    request = pack2(0xFE, Instruction.FAST_SYNC_READ, bytes([0x84, 0, 4, 0, 3, 7, 4]))
    assert ask(servos, request) == [FAST_SYNC_READ_ANSWER]


def test_a_fast_bulk_read_is_answered_in_one_packet() -> None:
    servos = rack(xm(1, 166), xm(2, 2079), voltage_v=11.9)
    [raw] = ask(servos, pack2(0xFE, Instruction.FAST_BULK_READ, bytes.fromhex("01 84 00 04 00 02 90 00 02 00")))
    [packet] = Parser().feed(raw)
    assert packet.intact
    assert (packet.params[:6], packet.params[8:12]) == (bytes([0, 1, 166, 0, 0, 0]), bytes([0, 2, 119, 0]))


def test_the_manual_s_ax_answers_are_given_byte_for_byte() -> None:
    servos = rack(ax(1))
    servos.servo(1).temperature_c = 32.0
    for name in ("ping", "read", "reg write"):
        assert ask(servos, example(1, name).request_bytes) == example(1, name).answer_bytes
    assert servos.servo(1).table.get("goal_position") == 512
    assert ask(servos, example(1, "action").request_bytes) == []
    assert servos.servo(1).table.get("goal_position") == 500


def test_a_1_0_sync_write_sets_goal_and_speed_of_each() -> None:
    servos = rack(ax(0), ax(1))
    assert ask(servos, example(1, "sync write").request_bytes) == []
    tables = [servos.servo(i).table for i in (0, 1)]
    assert [(t.get("goal_position"), t.get("moving_speed")) for t in tables] == [(0x10, 0x150), (0x220, 0x360)]


def test_a_1_0_bulk_read_is_answered_in_its_order() -> None:
    servos = rack(ax(1), ax(2))
    answers = ask(servos, example(1, "bulk read").request_bytes)
    assert answers == [pack1(1, 0, bytes([0x00, 0x02])), pack1(2, 0, bytes([0x00, 0x02]))]


def test_a_1_0_write_to_all_is_obeyed_by_all_and_answered_by_none() -> None:
    servos = rack(ax(7))
    assert ask(servos, example(1, "write").request_bytes) == []
    assert servos.servos[0].id == 1


@pytest.mark.parametrize("instruction", [Instruction.SYNC_READ, Instruction.FAST_SYNC_READ])
def test_servos_behind_a_missing_one_stay_silent(instruction: Instruction) -> None:
    servos = rack(xm(1), xm(2), xm(3))
    request = pack2(0xFE, instruction, bytes([0x84, 0, 4, 0, 1, 2, 3]))
    whole = b"".join(ask(servos, request))
    servos.inject(Fault(kind=FaultKind.MISSING, id=2))
    first_only = b"".join(ask(servos, request))
    assert whole.startswith(first_only)
    assert len(first_only) == {Instruction.SYNC_READ: 15, Instruction.FAST_SYNC_READ: 16}[instruction]


@pytest.mark.parametrize("instruction", [Instruction.SYNC_READ, Instruction.FAST_SYNC_READ])
def test_servos_answer_again_when_the_missing_one_is_left_out(instruction: Instruction) -> None:
    servos = rack(xm(1), xm(2), xm(3))
    servos.inject(Fault(kind=FaultKind.MISSING, id=2))
    stream = b"".join(ask(servos, pack2(0xFE, instruction, bytes([0x84, 0, 4, 0, 1, 3]))))
    packets = Parser().feed(stream)
    assert all(packet.intact for packet in packets)
    assert sum(packet.params.count(bytes([0, 8, 0, 0])) for packet in packets) == 2


@pytest.mark.parametrize(
    ("address", "data", "error"),
    [
        (0, [1, 0], Error2.ACCESS),  # Model Number is read only
        (132, [0, 0, 0, 0], Error2.ACCESS),
        (14, [0], Error2.ACCESS),  # nothing there
        (116, [0, 1], Error2.DATA_LENGTH),
        (116, [0, 0, 0, 0, 1], Error2.ACCESS),
        (64, [2], Error2.DATA_RANGE),
        (98, [0xFF], Error2.DATA_RANGE),
        (11, [2], Error2.DATA_RANGE),  # no such mode
        (116, [0, 0x10, 0, 0], Error2.DATA_LIMIT),  # 4096 is beyond Max Position Limit
        (116, [0xFF, 0xFF, 0xFF, 0xFF], Error2.DATA_LIMIT),
        (102, [0xAA, 0x04], Error2.DATA_RANGE),
    ],
)
def test_an_xm_refuses_a_write_with_the_manual_s_error_number(address: int, data: list[int], error: Error2) -> None:
    servos = rack(xm(1))
    before = bytes(servos.servo(1).table.bytes)
    assert ask2(servos, 1, Instruction.WRITE, address, 0, *data) == (error, b"")
    assert bytes(servos.servo(1).table.bytes) == before


def test_torque_locks_the_eeprom_of_an_xm() -> None:
    servos = rack(xm(1))
    assert ask2(servos, 1, Instruction.WRITE, 9, 0, 5) == (0, b"")
    assert ask2(servos, 1, Instruction.WRITE, 64, 0, 1) == (0, b"")
    assert ask2(servos, 1, Instruction.WRITE, 9, 0, 6) == (Error2.ACCESS, b"")
    assert ask2(servos, 1, Instruction.READ, 9, 0, 1, 0) == (0, b"\x05")


def test_unknown_or_empty_instructions_get_an_instruction_error() -> None:
    servos = rack(xm(1), ax(2))
    assert ask2(servos, 1, 0x77) == (Error2.INSTRUCTION, b"")
    assert ask2(servos, 1, Instruction.ACTION) == (Error2.INSTRUCTION, b"")
    assert ask(servos, example(2, "factory reset").request_bytes)[0][8] == Error2.INSTRUCTION
    assert ask1(servos, 2, 0x77) == (Error1.INSTRUCTION, b"")
    assert ask1(servos, 2, Instruction.ACTION) == (Error1.INSTRUCTION, b"")


def test_damaged_instructions_are_reported_and_not_obeyed() -> None:
    servos = rack(xm(1), ax(2))
    assert ask(servos, pack2(1, Instruction.WRITE, bytes([64, 0, 1]))[:-1] + b"\x00")[0][8] == Error2.CRC
    assert ask(servos, pack1(2, Instruction.WRITE, bytes([24, 1]))[:-1] + b"\x00")[0][4] == Error1.CHECKSUM
    assert not servos.servo(1).torque_on
    assert not servos.servo(2).torque_on


@pytest.mark.parametrize(
    ("address", "data", "error"),
    [
        (0, [1, 0], Error1.RANGE),
        (36, [0, 0], Error1.RANGE),
        (28, [1], Error1.RANGE),
        (30, [0xFF, 0x7F], Error1.RANGE),
        (200, [1], Error1.RANGE),
    ],
)
def test_an_ax_refuses_a_write_with_a_range_error(address: int, data: list[int], error: Error1) -> None:
    assert ask1(rack(ax(1)), 1, Instruction.WRITE, address, *data) == (error, b"")


def test_an_ax_refuses_a_goal_outside_its_angle_limits() -> None:
    servos = rack(ax(1))
    assert ask1(servos, 1, Instruction.WRITE, 8, 0x00, 0x03) == (0, b"")
    assert ask1(servos, 1, Instruction.WRITE, 30, 0x01, 0x03) == (Error1.ANGLE_LIMIT, b"")
    assert ask1(servos, 1, Instruction.READ, 24, 1) == (0, b"\0")


def test_a_locked_ax_takes_torque_and_goals_only() -> None:
    servos = rack(ax(1))
    assert ask1(servos, 1, Instruction.WRITE, 47, 1) == (0, b"")
    assert ask1(servos, 1, Instruction.WRITE, 48, 0x40, 0) == (Error1.RANGE, b"")
    assert ask1(servos, 1, Instruction.WRITE, 30, 0x00, 0x02) == (0, b"")


@pytest.mark.parametrize(("level", "answered"), [(0, "ping"), (1, "ping read"), (2, "ping read write")])
def test_status_return_level_says_what_is_answered(level: int, answered: str) -> None:
    servos = rack(xm(1), ax(2))
    servos.servo(1).table.put("status_return_level", level)
    servos.servo(2).table.put("status_return_level", level)
    requests = {
        "ping": (pack2(1, Instruction.PING), pack1(2, Instruction.PING)),
        "read": (pack2(1, Instruction.READ, bytes([132, 0, 4, 0])), pack1(2, Instruction.READ, bytes([36, 2]))),
        "write": (pack2(1, Instruction.WRITE, bytes([65, 0, 1])), pack1(2, Instruction.WRITE, bytes([25, 1]))),
    }
    for name, pair in requests.items():
        assert [len(ask(servos, raw)) for raw in pair] == [int(name in answered.split())] * 2
    assert [servos.servo(i).table.get("led") for i in (1, 2)] == [1, 1]


def test_two_servos_with_one_id_answer_in_collided_bytes_where_they_differ() -> None:
    servos = rack(xm(1, 166), ax(2))
    ping, where = pack2(1, Instruction.PING), pack2(1, Instruction.READ, bytes([132, 0, 4, 0]))
    alone = [ask(servos, ping), ask(servos, where)]
    servos.inject(Fault(kind=FaultKind.TWIN, id=1))
    assert ask(servos, ping) == alone[0], "the same model and firmware: the same bytes at the same time"
    [collided] = ask(servos, where)
    assert collided != alone[1][0]
    assert not Parser().feed(collided) or not Parser().feed(collided)[0].intact
    servos.clear()
    assert ask(servos, where) == alone[1]


def test_registers_are_as_somebody_left_them_and_ram_is_forgotten_by_a_restart() -> None:
    left = xm(1, 166).model_copy(update={"registers": {"homing_offset": 100, "status_return_level": 1}})
    servos = rack(left)
    assert [servos.servo(1).table.get(name) for name in left.registers] == [100, 1]
    ask(servos, pack2(1, Instruction.REBOOT))
    assert [servos.servo(1).table.get(name) for name in left.registers] == [100, 2]


def test_a_secondary_id_is_obeyed_in_ram_and_never_answered() -> None:
    servos = rack(xm(1), xm(2))
    servos.servo(2).table.put("secondary_id", 1)
    assert len(ask(servos, pack2(1, Instruction.WRITE, bytes([65, 0, 1])))) == 1
    assert [servos.servo(i).table.get("led") for i in (1, 2)] == [1, 1]
    assert len(ask(servos, pack2(1, Instruction.WRITE, bytes([11, 0, 4])))) == 1
    assert [servos.servo(i).table.get("operating_mode") for i in (1, 2)] == [4, 3]
    ask(servos, pack2(0xFE, Instruction.SYNC_WRITE, bytes([116, 0, 4, 0, 1, 0xE8, 3, 0, 0])))
    assert [servos.servo(i).table.get("goal_position") for i in (1, 2)] == [1000, 1000]


def test_an_xm_may_be_set_to_protocol_1() -> None:
    servos = rack(xm(1, 166))
    servos.servo(1).table.put("protocol_type", 1)
    assert ask(servos, pack2(1, Instruction.PING)) == []
    assert ask1(servos, 1, Instruction.READ, 132, 4) == (0, bytes([166, 0, 0, 0]))


@pytest.mark.parametrize(("offset", "reads"), [(1000, 1166), (-1024, -858), (1025, 166)])
def test_a_homing_offset_beyond_a_quarter_turn_is_ignored_in_position_control(offset: int, reads: int) -> None:
    servos = rack(xm(1, 166))
    servos.servo(1).table.put("homing_offset", offset)
    _, data = ask2(servos, 1, Instruction.READ, 132, 0, 4, 0)
    assert int.from_bytes(data, "little", signed=True) == reads


def test_startup_configuration_switches_torque_on_after_a_restart_where_the_servo_is() -> None:
    servos = rack(xm(1, 166))
    servos.servo(1).table.put("startup_configuration", 1)
    assert ask2(servos, 1, Instruction.REBOOT) == (0, b"")
    assert servos.servo(1).torque_on
    assert servos.servo(1).table.get("goal_position") == 166


def test_indirect_data_read_and_write_what_their_addresses_point_to() -> None:
    servos = rack(xm(1, 166))
    targets = [64, *range(116, 120), *range(132, 136), 146]
    addresses = [byte for target in targets for byte in target.to_bytes(2, "little")]
    assert ask2(servos, 1, Instruction.WRITE, 168, 0, *addresses) == (0, b"")
    assert ask2(servos, 1, Instruction.WRITE, 224, 0, 1, 0x2C, 0x01, 0, 0) == (0, b"")
    assert servos.servo(1).torque_on
    error, data = ask2(servos, 1, Instruction.READ, 224, 0, len(targets), 0)
    assert (error, data[:5], data[5:9]) == (0, bytes([1, 0x2C, 0x01, 0, 0]), bytes([166, 0, 0, 0]))
    assert ask2(servos, 1, Instruction.WRITE, 229, 0, 1, 1, 1, 1) == (Error2.ACCESS, b"")


def test_the_alert_bit_comes_with_every_answer_while_there_is_a_hardware_error() -> None:
    servos = rack(xm(1))
    servos.inject(Fault(kind=FaultKind.HOT, id=1, for_s=0.1))
    assert ask2(servos, 1, Instruction.PING)[0] == ALERT
    assert ask2(servos, 1, Instruction.WRITE, 0, 0, 1)[0] == ALERT | Error2.ACCESS
    assert ask2(servos, 1, Instruction.READ, 70, 0, 1, 0) == (ALERT, b"\x04")


instructions = st.sampled_from(list(Instruction))
parameters = st.one_of(
    st.binary(max_size=12),
    st.builds(
        lambda address, width, data: address.to_bytes(width, "little") + data,
        st.integers(0, 255),
        st.sampled_from([1, 2]),
        st.binary(max_size=8),
    ),
)


@given(
    st.lists(
        st.tuples(st.sampled_from([1, 2]), st.sampled_from([1, 2, 3, 0xFE]), instructions, parameters),
        max_size=20,
    )
)
def test_no_instruction_breaks_the_servos_or_what_is_read_only(sent: list[tuple[int, int, int, bytes]]) -> None:
    servos = rack(xm(1), ax(2))
    for protocol, servo_id, instruction, params in sent:
        for said in servos.answer(Packet(protocol, servo_id, instruction, params)):
            [packet] = Parser().feed(said.data)
            assert packet.intact
            assert packet.protocol == protocol
        servos.step(0.01)
    assert [servo.table.get("model_number") for servo in servos.servos] == [1030, 12]
    assert all(math.isfinite(value) for values in servos.motion() for value in values)


@given(st.data())
def test_what_a_register_takes_it_gives_back(data: st.DataObject) -> None:
    servos = rack(xm(1), ax(2))
    servo = data.draw(st.sampled_from(servos.servos))
    free = [
        register
        for register in servo.model.registers
        if register.writable and register.name not in {"id", "lock"} and not register.name.startswith("indirect")
    ]
    register = data.draw(st.sampled_from(free))
    value = data.draw(st.integers(register.minimum, register.maximum))
    raw = (value & (1 << 8 * register.size) - 1).to_bytes(register.size, "little")
    before = servo.read(register.address, register.size)
    refusal = servo.write(register.address, raw)
    assert servo.read(register.address, register.size) == (raw if refusal is None else before)


def test_an_answer_that_the_host_echoes_means_nothing() -> None:
    servos = rack(xm(1), ax(2))
    assert servos.answer(Packet(2, 1, Instruction.STATUS, b"\0")) == []
