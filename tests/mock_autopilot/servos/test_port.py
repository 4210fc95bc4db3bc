"""The port of the servo bus: its link, who owns it, and what is left of it afterwards."""

import asyncio
import os
import subprocess
import sys
import termios
import tty
from collections.abc import Callable
from pathlib import Path

import pytest

from mock_autopilot.servos.bus import BusStartError, ServoBus
from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind
from mock_autopilot.servos.packets import pack2
from tests.mock_autopilot.servos.dynamixel_examples import PROTOCOL_2

PING = PROTOCOL_2[0].request_bytes


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "servo-bus"


def linked(link: Path) -> ServoBus:
    return ServoBus(DynamixelConfig(link=str(link), check_baud=False))


def target(link: Path) -> Path | None:
    """Return the link's target; None when there is none."""
    return link.readlink() if link.is_symlink() else None


def is_device(path: Path | None) -> bool:
    return path is not None and path.is_char_device()


async def eventually(so: Callable[[], bool]) -> bool:
    for _ in range(1000):
        if so():
            return True
        await asyncio.sleep(0.01)
    return False


async def answer_to(path: str, request: bytes, size: int) -> bytes:
    """Return the bytes that a host reads after it has written, with default terminal settings."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(fd, request)
        return await asyncio.wait_for(asyncio.to_thread(os.read, fd, size), 10.0)
    finally:
        os.close(fd)


async def test_a_host_that_sets_nothing_finds_a_raw_port(link: Path) -> None:
    bus = linked(link)
    bus.open()
    try:
        fd = os.open(bus.path, os.O_RDWR | os.O_NOCTTY)
        mode = termios.tcgetattr(fd)
        os.close(fd)
        assert not mode[tty.LFLAG] & (termios.ICANON | termios.ECHO | termios.ISIG)
        assert not mode[tty.IFLAG] & (termios.ICRNL | termios.IXON)
        assert not mode[tty.OFLAG] & termios.OPOST
        assert len(await answer_to(bus.path, PING, 14)) == 14
    finally:
        bus.close()


async def test_without_a_link_the_path_is_the_terminal_s() -> None:
    bus = ServoBus(DynamixelConfig(check_baud=False))
    bus.open()
    try:
        assert bus.path.startswith("/dev/")
        assert len(await answer_to(bus.path, PING, 14)) == 14
    finally:
        bus.close()


async def test_the_link_is_there_while_the_bus_is_and_gone_afterwards(link: Path) -> None:
    bus = linked(link)
    bus.open()
    assert bus.path == str(link)
    assert is_device(target(link))
    bus.close()
    assert target(link) is None
    bus.open()
    assert len(await answer_to(bus.path, PING, 14)) == 14
    bus.close()


async def test_a_link_of_a_living_bus_is_in_use_and_stays_untouched(link: Path) -> None:
    first, second = linked(link), linked(link)
    first.open()
    try:
        with pytest.raises(BusStartError, match=r"servo-bus is in use by another simulated servo bus: stop that one"):
            second.open()
        assert len(await answer_to(first.path, PING, 14)) == 14
    finally:
        first.close()
    second.open()
    second.close()


async def test_a_link_left_behind_by_a_killed_process_is_replaced(link: Path) -> None:
    code = f"""
import asyncio, os, signal
from mock_autopilot.servos.bus import ServoBus
from mock_autopilot.servos.config import DynamixelConfig
async def main():
    ServoBus(DynamixelConfig(link={str(link)!r})).open()
    os.kill(os.getpid(), signal.SIGKILL)
asyncio.run(main())
"""
    await asyncio.to_thread(subprocess.run, [sys.executable, "-c", code], check=False)
    assert target(link) is not None
    bus = linked(link)
    bus.open()
    try:
        assert len(await answer_to(bus.path, PING, 14)) == 14
    finally:
        bus.close()


def test_a_file_in_the_link_s_place_is_not_overwritten(link: Path) -> None:
    link.write_text("precious")
    with pytest.raises(BusStartError, match=r"servo-bus is a file and no link: remove it or choose another link"):
        linked(link).open()
    assert link.read_text() == "precious"


async def test_a_link_in_a_missing_folder_is_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(BusStartError, match=r"cannot make the link .*/nowhere/bus: No such file or directory"):
        linked(tmp_path / "nowhere" / "bus").open()


async def test_time_is_brought_to_the_present_before_an_answer_is_given(link: Path) -> None:
    bus = ServoBus(DynamixelConfig(link=str(link), check_baud=False), lambda: bus.servos.step(0.25))
    bus.open()
    try:
        request = pack2(1, 0x02, bytes([120, 0, 2, 0]))
        await answer_to(bus.path, request, 13)
        assert bus.servos.time_s == 0.25
        raw = await answer_to(bus.path, request, 13)
        assert int.from_bytes(raw[9:11], "little") == 500
    finally:
        bus.close()


async def test_a_gone_port_comes_back_by_itself(link: Path) -> None:
    bus = linked(link)
    bus.open()
    try:
        before = target(link)
        fd = os.open(bus.path, os.O_RDWR | os.O_NOCTTY)
        bus.inject(Fault(kind=FaultKind.PORT_GONE, for_s=0.5))
        with pytest.raises(OSError, match="Input/output error"):
            os.write(fd, PING)
        assert not is_device(before)
        bus.servos.step(0.6)
        assert await eventually(lambda: is_device(target(link)))
        os.close(fd)
        assert len(await answer_to(bus.path, PING, 14)) == 14
    finally:
        bus.close()


async def test_faults_may_be_injected_before_the_bus_is_open(link: Path) -> None:
    bus = linked(link)
    bus.inject(Fault(kind=FaultKind.SILENT_BUS))
    bus.inject(Fault(kind=FaultKind.PORT_GONE))
    assert target(link) is None
    bus.open()
    assert target(link) is None
    bus.clear()
    assert is_device(target(link))
    bus.close()


async def test_answers_that_nobody_reads_do_not_stop_the_bus(link: Path) -> None:
    bus = linked(link)
    bus.open()
    fd = os.open(bus.path, os.O_RDWR | os.O_NOCTTY)
    try:
        for _ in range(40):
            os.write(fd, PING * 20)
            await asyncio.sleep(0)
        termios.tcflush(fd, termios.TCIFLUSH)
        await asyncio.sleep(0.05)
        termios.tcflush(fd, termios.TCIFLUSH)
        os.write(fd, PING)
        assert len(await asyncio.wait_for(asyncio.to_thread(os.read, fd, 14), 10.0)) == 14
    finally:
        os.close(fd)
        bus.close()
