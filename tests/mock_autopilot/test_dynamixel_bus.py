"""The servo bus, driven by the real SDK alone; the servos' time is the wall clock's."""

import asyncio
import termios
import time
from collections.abc import Callable

import dynamixel_sdk as dxl
import pytest

from mock_autopilot.dynamixel_alone import BusAlone
from mock_autopilot.dynamixel_config import DynamixelConfig, Fault, FaultKind, ServoConfig
from tests.mock_autopilot.dynamixel_host import BROKEN, NO_ANSWER, OK, Host, opened, powered, talk

XM_IDS, AX_IDS = (1, 2, 3, 5, 6, 7), (4, 8)
TORQUE, LED, ERROR, GOAL, POSITION, VOLTAGE = 64, 65, 70, 116, 132, 144
AX_TORQUE, AX_LED, AX_GOAL, AX_LIMIT, AX_POSITION = 24, 25, 30, 34, 36
ALERT = 0x80


async def within(bus: BusAlone, what: Callable[[Host], bool], for_s: float = 10.0) -> bool:
    """Ask again until it is so."""

    def patiently(host: Host) -> bool:
        end_s = time.monotonic() + for_s
        while not what(host):
            if time.monotonic() > end_s:
                return False
            time.sleep(0.02)
        return True

    return await talk(bus, patiently)


def torque_on(host: Host) -> None:
    for servo in XM_IDS:
        assert host.two.write1ByteTxRx(host.port, servo, TORQUE, 1) == (OK, 0)
    for servo in AX_IDS:
        assert host.one.write1ByteTxRx(host.port, servo, AX_TORQUE, 1) == (OK, 0)


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


async def test_a_missing_servo_leaves_the_others_to_single_reads() -> None:
    def look(host: Host) -> tuple[int, list[int]]:
        read = dxl.GroupSyncRead(host.port, host.two, POSITION, 4)
        for servo in XM_IDS:
            read.addParam(servo)
        return read.fastSyncRead(), [host.two.read4ByteTxRx(host.port, servo, POSITION)[1] for servo in XM_IDS]

    async with powered() as bus:
        bus.bus.inject(Fault(kind=FaultKind.MISSING, id=3))
        together, alone = await talk(bus, look)
        assert (together, alone) == (BROKEN, [OK, OK, NO_ANSWER, OK, OK, OK])
        bus.bus.clear()
        assert (await talk(bus, look))[0] == OK


async def test_late_answers_miss_the_host_s_time_limit_and_come_all_the_same() -> None:
    def ask(host: Host) -> tuple[int, bytes]:
        result = host.two.ping(host.port, 1)[1]
        time.sleep(0.3)
        return result, bytes(host.port.readPort(100))

    async with powered() as bus:
        bus.bus.inject(Fault(kind=FaultKind.LATE, id=1, late_s=0.15))
        result, afterwards = await talk(bus, ask)
    assert result == NO_ANSWER
    assert len(afterwards) == 14


async def test_corrupt_answers_are_no_answers() -> None:
    def ask(host: Host) -> list[int]:
        return [
            handler.ping(host.port, servo)[1] for _ in range(8) for handler, servo in ((host.two, 1), (host.one, 4))
        ]

    async with powered() as bus:
        bus.bus.inject(Fault(kind=FaultKind.CORRUPT))
        spoilt = await talk(bus, ask)
        bus.bus.clear()
        clean = await talk(bus, ask)
    assert OK not in spoilt
    assert BROKEN in spoilt
    assert set(clean) == {OK}


async def test_a_latched_overload_needs_a_reboot_of_an_xm() -> None:
    def state(host: Host) -> tuple[int, int, int]:
        status, _, error = host.two.read1ByteTxRx(host.port, 1, ERROR)
        return status, error, host.two.read1ByteTxRx(host.port, 1, TORQUE)[0]

    async with powered() as bus:
        await talk(bus, torque_on)
        bus.bus.inject(Fault(kind=FaultKind.OVERLOAD, id=1, for_s=0.05))
        assert await talk(bus, state) == (0x20, ALERT, 0)
        assert await within(bus, lambda _: bus.bus.servos.time_s > 0.2)
        assert (await talk(bus, lambda host: host.two.write1ByteTxRx(host.port, 1, TORQUE, 1)))[1] & ALERT
        assert (await talk(bus, state))[0] == 0x20
        assert (await talk(bus, lambda host: host.two.reboot(host.port, 1)))[0] == OK
        assert (await talk(bus, lambda host: host.two.ping(host.port, 1)))[1] == NO_ANSWER
        assert await within(bus, lambda host: host.two.ping(host.port, 1)[1] == OK)
        assert await talk(bus, state) == (0, 0, 0)
        assert await talk(bus, lambda host: host.two.write1ByteTxRx(host.port, 1, TORQUE, 1)) == (OK, 0)


async def test_a_latched_overload_of_an_ax_ends_with_a_new_torque_limit() -> None:
    def limit(host: Host) -> tuple[int, int, int]:
        value: tuple[int, int, int] = host.one.read2ByteTxRx(host.port, 4, AX_LIMIT)
        return value

    async with powered() as bus:
        await talk(bus, torque_on)
        bus.bus.inject(Fault(kind=FaultKind.OVERLOAD, id=4, for_s=0.05))
        assert await talk(bus, limit) == (0, OK, 0x20)
        assert await within(bus, lambda _: bus.bus.servos.time_s > 0.2)
        assert (await talk(bus, lambda host: host.one.write2ByteTxRx(host.port, 4, AX_LIMIT, 1023)))[0] == OK
        assert await within(bus, lambda host: limit(host) == (1023, OK, 0))


async def test_low_voltage_and_heat_show_in_both_protocols() -> None:
    def errors(host: Host) -> tuple[int, int]:
        return host.two.read1ByteTxRx(host.port, 1, ERROR)[0], host.one.ping(host.port, 4)[2]

    async with powered() as bus:
        bus.bus.inject(Fault(kind=FaultKind.VOLTAGE))
        assert await talk(bus, errors) == (0x01, 0x01)
        bus.bus.clear()
        bus.bus.inject(Fault(kind=FaultKind.HOT))
        assert await talk(bus, errors) == (0x04, 0x04)


async def test_a_servo_that_restarts_has_lost_its_torque() -> None:
    async with powered() as bus:
        await talk(bus, torque_on)
        bus.bus.inject(Fault(kind=FaultKind.REBOOT, id=5))
        assert await within(bus, lambda host: host.two.ping(host.port, 5)[1] == OK)
        assert await talk(bus, lambda host: host.two.read1ByteTxRx(host.port, 5, TORQUE)) == (0, OK, 0)
        assert await talk(bus, lambda host: host.two.read1ByteTxRx(host.port, 6, TORQUE)) == (1, OK, 0)


async def test_nothing_answers_on_a_silent_bus_until_the_cable_is_back() -> None:
    async with powered() as bus:
        bus.bus.inject(Fault(kind=FaultKind.SILENT_BUS))
        assert (await talk(bus, lambda host: host.two.ping(host.port, 1)))[1] == NO_ANSWER
        assert (await talk(bus, lambda host: host.one.ping(host.port, 4)))[1] == NO_ANSWER
        bus.bus.clear()
        assert (await talk(bus, lambda host: host.two.ping(host.port, 1)))[1] == OK


async def test_scripted_faults_come_and_go_by_themselves() -> None:
    fault = Fault(kind=FaultKind.MISSING, id=1, at_s=0.2, for_s=0.3)
    async with powered(DynamixelConfig(faults=(fault,))) as bus:
        assert await within(bus, lambda host: host.two.ping(host.port, 1)[1] == NO_ANSWER)
        assert await within(bus, lambda host: host.two.ping(host.port, 1)[1] == OK)
        assert bus.bus.servos.time_s >= 0.5


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


async def test_a_gone_port_dies_under_the_host_and_a_new_one_comes_under_the_same_link(tmp_path: object) -> None:
    link = f"{tmp_path}/bus"
    async with powered(DynamixelConfig(link=link)) as bus:
        with opened(bus.path) as host:
            assert (await asyncio.to_thread(host.two.ping, host.port, 1))[1] == OK
            bus.bus.inject(Fault(kind=FaultKind.PORT_GONE))
            with pytest.raises(termios.error, match="Input/output error"):
                await asyncio.to_thread(host.two.ping, host.port, 1)
        bus.bus.clear()
        assert (await talk(bus, lambda host: host.two.ping(host.port, 1)))[1] == OK
