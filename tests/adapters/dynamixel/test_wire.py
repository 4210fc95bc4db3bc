"""Answers that come late, to another question, or in another way than asked: none may be believed."""

import os
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from companion.adapters.dynamixel.port import BusPort, PortGoneError
from companion.adapters.dynamixel.registers import Answer, Ax, Block, Xm
from companion.adapters.dynamixel.wire import Wire
from mock_autopilot.servos.packets import pack1, status2


@dataclass
class Line:
    """A wire whose other end says what the test wants, whatever is asked."""

    wire: Wire
    host: int
    port: BusPort

    def says(self, *packets: bytes) -> None:
        """Have these waiting behind the next instruction, as if they came just after it."""
        plain_write = self.port.writePort

        def write(packet: list[int]) -> int:
            written = plain_write(packet)
            os.write(self.host, b"".join(packets))
            return written

        self.port.writePort = write  # type: ignore[method-assign]


@pytest.fixture
def line() -> Iterator[Line]:
    host, end = os.openpty()
    port = BusPort(os.ttyname(end), 1_000_000)
    port.open()
    line = Line(Wire(port), host, port)
    yield line
    port.closePort()
    os.close(end)
    if line.host >= 0:
        os.close(line.host)


DATA = bytes([1, 0, 0, 0, 2, 0, 0])


def test_the_answer_is_found_among_those_of_others_and_those_to_other_questions(line: Line) -> None:
    longer, shorter, other = status2(1, 0, bytes(8)), status2(1, 0, b""), status2(2, 0, DATA)
    line.says(longer, other, shorter, status2(1, 0x80, DATA))
    assert line.wire.read(2, 1, Xm.HEALTH) == Answer(64, DATA, 0x80)


def test_a_longer_answer_alone_is_none(line: Line) -> None:
    line.says(status2(1, 0, bytes(8)))
    assert line.wire.read(2, 1, Xm.HEALTH) is None
    assert line.wire.bad_packets == 1


def test_an_answer_by_protocol_1_likewise(line: Line) -> None:
    block = Block(24, 27)
    line.says(pack1(4, 0, bytes(4)), pack1(5, 0, bytes(3)), pack1(4, 0x20, bytes([1, 2, 3])))
    assert line.wire.read(1, 4, block) == Answer(24, bytes([1, 2, 3]), 0x20)
    line.says(pack1(4, 0, bytes(Ax.STATE.length + 1)))
    assert line.wire.read(1, 4, Ax.STATE) is None


def test_data_that_look_like_a_header_come_through_whole(line: Line) -> None:
    tricky = bytes.fromhex("ff ff fd ff ff fd 00")
    line.says(status2(1, 0, tricky))
    assert line.wire.read(2, 1, Xm.HEALTH) == Answer(64, tricky, 0)


def test_a_late_answer_does_not_make_a_ping(line: Line) -> None:
    line.says(status2(1, 0, DATA))
    assert line.wire.ping(2, 1) is None
    line.says(pack1(1, 0, b""))
    assert line.wire.ping(1, 1) is None


def test_a_broken_answer_is_none_and_is_counted(line: Line) -> None:
    good = status2(1, 0, DATA)
    line.says(good[:-1] + bytes([good[-1] ^ 1]))
    assert line.wire.read(2, 1, Xm.HEALTH) is None
    assert line.wire.bad_packets == 1


def test_a_fast_sync_read_is_not_fooled_by_a_single_answer(line: Line) -> None:
    line.says(status2(1, 0, bytes(Xm.STATE.length)))
    assert line.wire.fast_sync_read([1, 2], Xm.STATE) == {}


def test_a_sync_read_keeps_what_came_before_the_gap(line: Line) -> None:
    state = bytes(Xm.STATE.length)
    line.says(status2(1, 0, state), status2(3, 0x80, state))
    assert line.wire.sync_read([1, 2, 3], Xm.STATE) == {1: Answer(126, state, 0), 3: Answer(126, state, 0x80)}


def test_a_port_that_dies_is_said_to_be_gone(line: Line) -> None:
    os.close(line.host)
    line.host = -1
    with pytest.raises(PortGoneError):
        line.wire.read(2, 1, Xm.HEALTH)
