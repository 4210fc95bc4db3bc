"""The servo bus, driven by the real SDK alone."""

import dynamixel_sdk as dxl

from tests.mock_autopilot.dynamixel_host import NO_ANSWER, OK, Host, powered, talk

XM_IDS, AX_IDS = (1, 2, 3, 5, 6, 7), (4, 8)
TORQUE, GOAL, POSITION = 64, 116, 132
AX_TORQUE, AX_GOAL, AX_POSITION = 24, 30, 36


async def test_servos_answer_pings_in_their_own_protocol_only() -> None:
    def pings(host: Host) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        return [host.one.ping(host.port, i)[:2] for i in (1, 4)], [host.two.ping(host.port, i)[:2] for i in (1, 4)]

    async with powered() as bus:
        one, two = await talk(bus, pings)
    assert one == [(0, NO_ANSWER), (12, OK)]
    assert two == [(1020, OK), (0, NO_ANSWER)]


async def test_sync_write_moves_the_servos_and_both_sync_reads_agree() -> None:
    def move(host: Host) -> None:
        write = dxl.GroupSyncWrite(host.port, host.two, GOAL, 4)
        for servo in XM_IDS:
            host.two.write1ByteTxRx(host.port, servo, TORQUE, 1)
            write.addParam(servo, (2048 + 10 * servo).to_bytes(4, "little"))
        assert write.txPacket() == OK

    def look(host: Host) -> tuple[list[int], list[int]]:
        read = dxl.GroupSyncRead(host.port, host.two, POSITION, 4)
        for servo in XM_IDS:
            read.addParam(servo)
        assert read.txRxPacket() == OK
        plain = [read.getData(servo, POSITION, 4) for servo in XM_IDS]
        assert read.fastSyncRead() == OK
        return plain, [read.getData(servo, POSITION, 4) for servo in XM_IDS]

    async with powered() as bus:
        await talk(bus, move)
        for _ in range(500):
            bus.bus.servos.step(0.002)
        plain, fast = await talk(bus, look)
    assert plain == fast
    assert all(abs(at - (2048 + 10 * servo)) <= 2 for at, servo in zip(plain, XM_IDS, strict=True))
