"""Everything that can be wrong between a port and eight servos, and the sentence that says so."""

import asyncio
import os
import time
from pathlib import Path

import pytest
from pydantic import ValidationError

from companion.adapters.dynamixel import port
from companion.adapters.dynamixel.port import BusPort, latency_warning, name_warning
from companion.adapters.dynamixel.registers import Xm
from companion.adapters.dynamixel.wire import Wire
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError
from mock_autopilot.servos.config import FaultKind
from tests.adapters.dynamixel.rig import connected, mock_bus, refusal, servos, until

pytestmark = pytest.mark.realtime

XM, AX = "right.elbow_pitch (ID 2)", "right.claw (ID 4)"


async def test_one_error_names_all_that_is_missing_or_wrong() -> None:
    async with mock_bus(servos=servos(id1={"firmware": 30}, id6={"operating_mode": 5}, id7={"baud": 4_500_000})) as rig:
        rig.fault(FaultKind.MISSING, 3)
        rig.fault(FaultKind.MISSING, 8)
        lines = (await refusal(rig)).splitlines()
    assert lines[0] == f"the arms on {rig.bus.path or lines[0].split()[3]} cannot be used:"
    assert [line.split()[0] for line in lines[1:]] == [
        "right.shoulder_pitch", "left.elbow_pitch", "right.elbow_roll", "left.elbow_roll", "left.claw",
    ]  # fmt: skip
    assert "right.elbow_roll (ID 3) does not answer at 1000000 bits/s: look at its cable" in lines[3]
    assert "left.elbow_roll (ID 7) does not answer at 1000000 bits/s: it answers at 4500000, so set its" in lines[4]


async def test_an_interrupted_connect_ends_soon() -> None:
    async with mock_bus() as rig:
        rig.fault(FaultKind.SILENT_BUS)
        opening = asyncio.create_task(refusal(rig))
        await until(lambda: rig.packets)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening


async def test_a_port_that_is_no_serial_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no port")
    with pytest.raises(ArmError, match=r"cannot open .*file \(arms\.port\) at 1000000 bits/s.*must be a serial port"):
        BusPort(str(tmp_path / "file"), 1_000_000).open()


async def test_a_port_without_permission(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_args: object, **_more: object) -> int:
        raise PermissionError(13, "Permission denied")

    async with mock_bus() as rig:
        monkeypatch.setattr(os, "open", refused)
        with pytest.raises(ArmError, match=r"no permission to open .* `sudo usermod -aG dialout \$USER`"):
            BusPort(rig.bus.path, 1_000_000).open()


def test_a_baud_rate_that_not_all_servos_have_is_refused_in_the_file() -> None:
    with pytest.raises(
        ValidationError, match="baud = 2000000 is none that all these servos have; there are 9600, 57600"
    ):
        ArmsConfig(baud=2_000_000)


def adapter(tmp_path: Path, latency: str) -> str:
    device = tmp_path / "ttyUSB7"
    device.mkdir()
    (device / "latency_timer").write_text(latency)
    (tmp_path / "arms").symlink_to("/dev/ttyUSB7")
    return str(tmp_path / "arms")


def test_a_slow_latency_timer_is_complained_about_with_its_cure(tmp_path: Path) -> None:
    said = latency_warning(adapter(tmp_path, "16\n"), tmp_path)
    assert said is not None
    assert "latency timer is 16 ms" in said
    assert f"echo 1 | sudo tee {tmp_path}/ttyUSB7/latency_timer" in said


def test_a_quick_latency_timer_and_ports_without_one_are_fine(tmp_path: Path) -> None:
    assert latency_warning(adapter(tmp_path, "1\n"), tmp_path) is None
    assert latency_warning("/dev/pts/0", tmp_path) is None


def named_by_id(tmp_path: Path, device: str) -> str:
    """Return the device's path; a link by its serial number points to it."""
    (tmp_path / device).touch()
    by_id = tmp_path / "serial" / "by-id"
    by_id.mkdir(parents=True)
    (by_id / "usb-FTDI_U2D2_FT1").symlink_to(tmp_path / device)
    return str(tmp_path / device)


def test_a_port_by_its_number_is_complained_about_where_there_is_a_name_that_stays(tmp_path: Path) -> None:
    said = name_warning(named_by_id(tmp_path, "ttyUSB3"), tmp_path)
    assert said is not None
    assert said.endswith(f"once it is plugged in again: give {tmp_path}/serial/by-id/usb-FTDI_U2D2_FT1, which stays")
    assert name_warning(f"{tmp_path}/serial/by-id/usb-FTDI_U2D2_FT1", tmp_path) is None
    assert name_warning("/dev/pts/0", tmp_path) is None
    assert name_warning("/dev/ttyUSB0", tmp_path / "without links") is None


def test_a_number_that_is_gone_names_the_ports_that_are_there_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port, "_ports", lambda: ["/dev/serial/by-id/usb-FTDI_U2D2_FT1", "/dev/ttyUSB98"])
    with pytest.raises(ArmError) as caught:
        BusPort("/dev/ttyUSB97", 1_000_000).open()
    assert str(caught.value) == (
        "no serial port /dev/ttyUSB97 (arms.port): plug in the arms' USB adapter; there are: "
        "/dev/serial/by-id/usb-FTDI_U2D2_FT1, /dev/ttyUSB98; the number changes when an adapter is plugged in again, "
        "/dev/serial/by-id/... does not"
    )


async def test_the_warning_reaches_whoever_opened_the_bus_and_is_theirs_to_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with mock_bus() as rig:
        device = tmp_path / Path(rig.bus.path).name
        device.mkdir()
        (device / "latency_timer").write_text("16")
        monkeypatch.setattr(latency_warning, "__defaults__", (tmp_path,))
        rig.servo(1).table.put("homing_offset", 100)
        async with connected(rig) as bus:
            assert "latency timer is 16 ms" in bus.warnings[0]
            assert "(ID 1) has Homing Offset 100 (+0.15 rad)" in bus.warnings[1]
    assert "latency" not in caplog.text


def test_an_unanswered_question_costs_little_and_no_processor() -> None:
    host, wire = os.openpty()
    serial_port = BusPort(os.ttyname(wire), 1_000_000)
    serial_port.open()
    begun_s, used_s = time.monotonic(), time.process_time()
    for _ in range(20):
        assert Wire(serial_port).read(2, 1, Xm.STATE) is None
    assert time.process_time() - used_s < 0.5 * (time.monotonic() - begun_s)
    assert serial_port.packet_timeout == 0.0
    serial_port.setPacketTimeout(32)
    assert serial_port.packet_timeout == pytest.approx(32 * 0.01 + 4.0)
    serial_port.closePort()
    os.close(host)
    os.close(wire)
