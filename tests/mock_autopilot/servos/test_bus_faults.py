"""Every fault of the servo bus, as the real SDK sees it."""

import asyncio
import termios
import time

import dynamixel_sdk as dxl
import pytest

from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind
from tests.mock_autopilot.servos.dynamixel_host import (
    BROKEN,
    NO_ANSWER,
    OK,
    TORQUE,
    XM_IDS,
    Host,
    opened,
    powered,
    talk,
    torque_on,
    within,
)

ERROR, POSITION = 70, 132
AX_LIMIT = 34
ALERT = 0x80


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
