"""The servo bus, driven by the real SDK alone: every instruction, baud rates, timing."""

import time

import dynamixel_sdk as dxl
import pytest

from mock_autopilot.servos.config import DynamixelConfig, ServoConfig
from tests.mock_autopilot.servos.dynamixel_host import (
    AX_IDS,
    NO_ANSWER,
    OK,
    XM_IDS,
    Host,
    powered,
    talk,
    torque_on,
    within,
)

LED, GOAL, POSITION, VOLTAGE = 65, 116, 132, 144
AX_LED, AX_GOAL, AX_POSITION = 25, 30, 36


def positions(host: Host) -> list[int]:
    read = dxl.GroupSyncRead(host.port, host.two, POSITION, 4)
    for servo in XM_IDS:
        read.addParam(servo)
    assert read.fastSyncRead() == OK
    return [read.getData(servo, POSITION, 4) for servo in XM_IDS]


async def test_servos_answer_pings_in_their_own_protocol_only() -> None:
    def pings(host: Host) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        return [host.one.ping(host.port, i)[:2] for i in (1, 4)], [host.two.ping(host.port, i)[:2] for i in (1, 4)]

    async with powered() as bus:
        one, two = await talk(bus, pings)
    assert one == [(0, NO_ANSWER), (12, OK)]
    assert two == [(1020, OK), (0, NO_ANSWER)]


async def test_a_broadcast_ping_finds_every_xm_with_model_and_firmware() -> None:
    async with powered() as bus:
        found, result = await talk(bus, lambda host: host.two.broadcastPing(host.port))
    assert result == OK
    assert found == {servo: [1020, 45] for servo in XM_IDS}


async def test_sync_writes_of_both_protocols_move_all_servos() -> None:
    def move(host: Host) -> None:
        torque_on(host)
        write = dxl.GroupSyncWrite(host.port, host.two, GOAL, 4)
        for servo in XM_IDS:
            write.addParam(servo, (2048 + 10 * servo).to_bytes(4, "little"))
        assert write.txPacket() == OK
        write = dxl.GroupSyncWrite(host.port, host.one, AX_GOAL, 2)
        for servo in AX_IDS:
            write.addParam(servo, (500 + 10 * servo).to_bytes(2, "little"))
        assert write.txPacket() == OK

    def there(host: Host) -> bool:
        axes = [host.one.read2ByteTxRx(host.port, servo, AX_POSITION)[0] for servo in AX_IDS]
        return all(
            abs(at - goal) <= 4
            for at, goal in zip(positions(host) + axes, [2048 + 10 * i for i in XM_IDS] + [540, 580], strict=True)
        )

    async with powered() as bus:
        await talk(bus, move)
        assert await within(bus, there)


async def test_sync_read_and_fast_sync_read_agree() -> None:
    def look(host: Host) -> tuple[list[int], list[int]]:
        read = dxl.GroupSyncRead(host.port, host.two, VOLTAGE, 3)
        for servo in XM_IDS:
            read.addParam(servo)
        assert read.txRxPacket() == OK
        plain = [read.getData(servo, VOLTAGE, 2) for servo in XM_IDS]
        assert read.fastSyncRead() == OK
        return plain, [read.getData(servo, VOLTAGE, 2) for servo in XM_IDS]

    async with powered() as bus:
        plain, fast = await talk(bus, look)
    assert plain == fast == [120] * 6


async def test_bulk_reads_of_both_protocols_and_a_bulk_write_work() -> None:
    def bulk(host: Host) -> tuple[list[int], list[int], list[int]]:
        write = dxl.GroupBulkWrite(host.port, host.two)
        write.addParam(1, GOAL, 4, (2100).to_bytes(4, "little"))
        write.addParam(2, LED, 1, b"\1")
        assert write.txPacket() == OK
        two = dxl.GroupBulkRead(host.port, host.two)
        two.addParam(1, GOAL, 4)
        two.addParam(2, LED, 1)
        assert two.txRxPacket() == OK
        plain = [two.getData(1, GOAL, 4), two.getData(2, LED, 1)]
        assert two.fastBulkRead() == OK
        fast = [two.getData(1, GOAL, 4), two.getData(2, LED, 1)]
        # The SDK's own group read of Protocol 1.0 fails with a TypeError (4.1.0), its parts work.
        assert host.one.bulkReadTx(host.port, [2, 4, AX_POSITION, 1, 8, AX_LED], 6) == OK
        axes = [host.one.read2ByteRx(host.port, 4), host.one.read1ByteRx(host.port, 8)]
        assert [result for _, result, _ in axes] == [OK, OK]
        return plain, fast, [value for value, _, _ in axes]

    async with powered() as bus:
        plain, fast, axes = await talk(bus, bulk)
    assert plain == fast == [2100, 1]
    assert axes == [512, 0]


async def test_registered_writes_wait_for_the_action() -> None:
    def act(host: Host) -> list[int]:
        seen = []
        for handler, servo, led in ((host.two, 1, LED), (host.one, 4, AX_LED)):
            assert handler.regWriteTxRx(host.port, servo, led, 1, [1]) == (OK, 0)
            seen.append(handler.read1ByteTxRx(host.port, servo, led)[0])
            assert handler.action(host.port, 0xFE) == OK
            seen.append(handler.read1ByteTxRx(host.port, servo, led)[0])
        return seen

    async with powered() as bus:
        assert await talk(bus, act) == [0, 1, 0, 1]


async def test_torque_locks_the_eeprom() -> None:
    def lock(host: Host) -> list[tuple[int, int]]:
        first = host.two.write1ByteTxRx(host.port, 1, 9, 5)
        torque_on(host)
        return [first, host.two.write1ByteTxRx(host.port, 1, 9, 6)]

    async with powered() as bus:
        assert await talk(bus, lock) == [(OK, 0), (OK, 7)]


async def test_unknown_instructions_and_a_factory_reset_get_an_instruction_error() -> None:
    async with powered() as bus:
        assert await talk(bus, lambda host: host.two.factoryReset(host.port, 1, 0x02)) == (OK, 2)
        assert await talk(bus, lambda host: host.one.factoryReset(host.port, 4)) == (OK, 0x40)


async def test_a_port_at_another_baud_rate_hears_nothing() -> None:
    servos = (ServoConfig(id=1), ServoConfig(id=2, baud=57_600), ServoConfig(id=3, baud=3_000_000))
    async with powered(DynamixelConfig(servos=servos)) as bus:
        for baud, heard in ((1_000_000, {1}), (57_600, {2}), (3_000_000, {3}), (115_200, set())):
            found = await talk(bus, lambda host: {i for i in (1, 2, 3) if host.two.ping(host.port, i)[1] == OK}, baud)
            assert found == heard


@pytest.mark.parametrize(("baud", "delay_us"), [(9_600, 500), (57_600, 0)])
async def test_with_wire_timing_answers_take_the_time_of_their_bytes(baud: int, delay_us: int) -> None:
    servos = tuple(ServoConfig(id=i, baud=baud, return_delay_us=delay_us) for i in (1, 2, 3))

    def read_all(host: Host) -> float:
        read = dxl.GroupSyncRead(host.port, host.two, POSITION, 4)
        for servo in (1, 2, 3):
            read.addParam(servo)
        start_s = time.monotonic()
        assert read.txRxPacket() == OK
        return time.monotonic() - start_s

    async with powered(DynamixelConfig(servos=servos, wire_timing=True)) as bus:
        took_s = await talk(bus, read_all, baud)
    on_the_wire = 17 + 3 * 15
    assert took_s >= on_the_wire * 10 / baud + 3 * delay_us * 1e-6


async def test_a_packet_broken_off_is_forgotten_after_a_pause() -> None:
    def stutter(host: Host) -> int:
        host.port.writePort(bytes.fromhex("FF FF FD 00 01 09 00 03 74 00"))
        time.sleep(0.3)
        return int(host.two.ping(host.port, 1)[1])

    async with powered() as bus:
        assert await talk(bus, stutter) == OK


async def test_the_host_may_come_and_go() -> None:
    async with powered() as bus:
        for _ in range(5):
            assert (await talk(bus, lambda host: host.two.ping(host.port, 1)))[1] == OK
