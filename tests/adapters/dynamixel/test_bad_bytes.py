"""A servo bus that talks nonsense, at the real dynamixel-sdk and the driver: answers made bad, and one that babbles."""

import asyncio
import itertools
import random
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.adapters.dynamixel.bus import DynamixelBus
from companion.adapters.dynamixel.port import BusPort
from companion.adapters.dynamixel.registers import Ax, Xm
from companion.adapters.dynamixel.wire import Wire
from companion.core.interfaces import ArmError
from mock_autopilot.servos.packets import Block, fast_status, pack1, status2
from tests.adapters.bad_bytes import bad_stream, nothing_escapes
from tests.adapters.dynamixel.rig import PATIENCE_S, BusRig, connected, cycles, mock_bus

pytestmark = pytest.mark.realtime

BAD_CYCLES = 5
XM_IDS = (1, 2, 3, 5, 6, 7)
PACKETS = (
    fast_status([Block(servo_id, 0, bytes(20)) for servo_id in XM_IDS]),
    fast_status([Block(1, 0, b"\xff\xff\xfd" * 7)]),
    *(status2(servo_id, 0, bytes(20)) for servo_id in XM_IDS),
    status2(1, 0x80, b"\xff\xff\xfd\xfd" * 5),
    status2(2, 7),
    status2(3, 0, b"\x42"),
    status2(0xFE, 0, bytes(300)),
    *(pack1(servo_id, 0, bytes(8)) for servo_id in (4, 8)),
    pack1(4, 0x7F),
    pack1(8, 0, b"\xff\xff" * 20),
)


class Tampering:
    """Between the mock's servos and the wire: says what the test wants instead of, or behind, every answer."""

    def __init__(self, rig: BusRig) -> None:
        self._put = rig.bus._put
        self._instead: Iterator[bytes] | None = None
        self._as_well = False
        rig.bus._put = self._say  # type: ignore[method-assign]

    def begin(self, instead: Sequence[bytes], as_well: bool) -> None:
        self._instead, self._as_well = itertools.cycle(instead), as_well

    def end(self) -> None:
        self._instead = None

    def _say(self, data: bytes, at_s: float) -> None:
        bad = next(self._instead) if self._instead is not None else b""
        self._put(data if not bad else bad + data if self._as_well else bad, at_s)


async def recovers(bus: DynamixelBus) -> None:
    """Good answers are taken again, once the operator has cleared what the bad ones left."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                await bus.clear_faults()
            except ArmError:
                continue
            seen_s = bus.status().read_s
            await cycles(bus, 12)
            status = bus.status()
            if (status.read_s > seen_s).all() and not status.faults:
                return


async def outlived(bad: Sequence[bytes], as_well: bool) -> None:
    """Check the property: after these bytes the bus still works."""
    async with nothing_escapes(), mock_bus() as rig, connected(rig) as bus:
        tampering = Tampering(rig)
        tampering.begin(bad, as_well)
        await cycles(bus, BAD_CYCLES)
        tampering.end()
        assert not [fault for fault in bus.status().faults if "driver failed" in fault.text]
        await recovers(bus)


@settings(max_examples=5)
@given(st.lists(bad_stream(PACKETS), min_size=1, max_size=6), st.booleans())
async def test_bad_answers_are_outlived(bad: list[bytes], as_well: bool) -> None:
    await outlived(bad, as_well)


async def refused_or_used(bad: Sequence[bytes], as_well: bool) -> None:
    """Check the property while connecting: only an ArmError is raised."""
    async with nothing_escapes(), mock_bus() as rig, asyncio.timeout(3.0 * PATIENCE_S):
        Tampering(rig).begin(bad, as_well)
        said = ""
        try:
            async with connected(rig) as bus:
                await cycles(bus, 1)
        except ArmError as error:
            said = str(error)
        assert "unexpectedly" not in said


@settings(max_examples=1)
@given(st.lists(bad_stream(PACKETS), min_size=1, max_size=6), st.booleans())
async def test_bad_answers_while_connecting_are_a_sentence(bad: list[bytes], as_well: bool) -> None:
    await refused_or_used(bad, as_well)


_BABBLE = """import os, select, sys
while True:
    select.select([], [1], [])
    try:
        os.write(1, bytes.fromhex(sys.argv[1]))
    except BlockingIOError:
        pass
"""


@contextmanager
def babbling(rig: BusRig, said: bytes) -> Iterator[None]:
    """Somebody on the wire never stops, and is faster than we can listen: a process of its own."""
    assert rig.bus._port is not None
    with subprocess.Popen([sys.executable, "-c", _BABBLE, said.hex()], stdout=rig.bus._port.master) as process:
        try:
            yield
        finally:
            process.kill()


NOISE = random.Random(1).randbytes(500)


BABBLE = {
    "noise": NOISE,
    "stuck": b"\xff" * 500,
    "heads": b"\xff\xff\xfd\x00" * 100,
    "another's answer": status2(9, 0, bytes(20)),
    "another's answer by protocol 1": pack1(9, 0, bytes(8)),
}


@pytest.mark.parametrize("said", BABBLE.values(), ids=BABBLE.keys())
async def test_a_servo_that_babbles_holds_up_nobody(said: bytes) -> None:
    async with nothing_escapes(), mock_bus() as rig, asyncio.timeout(2.0 * PATIENCE_S), connected(rig) as bus:
        with babbling(rig, said):
            await cycles(bus, 3)
        await recovers(bus)


class Endless(BusPort):
    """A line that is never silent, however fast it is read."""

    def __init__(self, path: str, said: bytes) -> None:
        super().__init__(path, 1_000_000)
        self._said = said

    def _receive(self, timeout_s: float) -> bytes:  # noqa: ARG002
        return self._said * (4096 // len(self._said))


@pytest.mark.parametrize("said", BABBLE.values(), ids=BABBLE.keys())
async def test_every_question_ends_on_a_line_that_never_does(said: bytes) -> None:
    async with mock_bus() as rig:
        port = Endless(rig.bus.path, said)
        port.open()
        wire = Wire(port)

        def ask() -> None:
            for protocol, servo_id, block in ((1, 4, Ax.STATE), (2, 1, Xm.STATE)):
                assert wire.read(protocol, servo_id, block) is None
                assert wire.ping(protocol, servo_id) is None
                assert wire.write(protocol, servo_id, 64, b"\x01") is None
            assert not wire.sync_read(XM_IDS, Xm.STATE)
            assert not wire.fast_sync_read(XM_IDS, Xm.STATE)

        asking = threading.Thread(target=ask, daemon=True)
        asking.start()
        await asyncio.to_thread(asking.join, PATIENCE_S)
        assert not asking.is_alive()
        port.closePort()
