"""Everything that can be wrong between a port and eight servos, and the sentence that says so."""

import asyncio
import os
import time
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from companion.adapters.dynamixel.port import BusPort, latency_warning
from companion.adapters.dynamixel.registers import Xm
from companion.adapters.dynamixel.wire import Wire
from companion.config_arms import ArmsConfig
from companion.ports import ArmError
from mock_autopilot.dynamixel_config import FaultKind
from tests.adapters.dynamixel_rig import connected, mock_bus, refusal, servos, until

pytestmark = pytest.mark.realtime

XM, AX = "right.elbow_pitch (ID 2)", "right.claw (ID 4)"


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"id2": {"model": "XM430-W210"}}, f"{XM} is XM430-W210, and should be XM430-W350"),
        ({"id2": {"firmware": 37}}, f"{XM} has firmware 37, and should have 38 or newer"),
        ({"id2": {"return_delay_us": 500}}, f"{XM} waits 500 us before it answers, and should wait 0"),
        ({"id4": {"return_delay_us": 500}}, f"{AX} waits 500 us before it answers, and should wait 0"),
        ({"id2": {"operating_mode": 4}}, f"{XM} is in extended position control (Operating Mode 4), and should be in"),
        ({"id2": {"start_position_rad": 6.2}}, f"{XM} stands at 3.06 rad, and should be within -0.2 to 2.6"),
        ({"id4": {"start_position_rad": 0.0}}, f"{AX} stands at -2.62 rad, and should be within 0 to 1"),
    ],
)
async def test_a_servo_that_is_set_wrong(changes: dict[str, Any], wanted: str) -> None:
    async with mock_bus(servos=servos(**changes)) as rig:
        said = await refusal(rig)
    assert wanted in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("servo_id", "register", "value", "wanted"),
    [
        (2, "baud_rate", 1, f"{XM} is set to 57600 bits/s, and should be to 1000000"),
        (4, "baud_rate", 16, f"{AX} is set to 117647 bits/s, and should be to 1000000"),
        (2, "drive_mode", 1, f"{XM} has Drive Mode 1, and should have 0"),
        (2, "drive_mode", 8, f"{XM} has Drive Mode 8, and should have 0"),
        (4, "ccw_angle_limit", 0, f"{AX} is in wheel mode, and should be in joint mode"),
        (4, "ccw_angle_limit", 600, f"{AX} accepts -2.62 to 0.45 rad, and should accept the joint's limits 0 to 1"),
        (2, "max_position_limit", 3000, f"{XM} accepts -3.14 to 1.46 rad, and should accept"),
    ],
)
async def test_a_register_that_is_wrong(servo_id: int, register: str, value: int, wanted: str) -> None:
    async with mock_bus() as rig:
        if register == "baud_rate":  # the register says it, the servo will do it after its next start
            kind = type(rig.servo(servo_id))
            rig.servo(servo_id).__class__ = type("Stubborn", (kind,), {"baud": 1_000_000})
        rig.servo(servo_id).table.put(register, value)
        said = await refusal(rig)
    assert wanted in said
    assert said.count("\n") == 1


async def test_a_servo_that_answers_writes_with_silence() -> None:
    async with mock_bus() as rig:
        rig.servo(2).table.put("status_return_level", 1)
        assert f"{XM} has Status Return Level 1, and should have 2" in await refusal(rig)


async def test_low_voltage_and_heat() -> None:
    async with mock_bus(voltage_v=9.7, ambient_c=60.0) as rig:
        said = await refusal(rig, max_temperature_c=60.0)
    assert said.count("has 9.7 V, and should have 10 V or more: charge the battery") == 8
    assert said.count("has 65 degrees C, and should have 60 or less: let it cool down") == 8


async def test_an_error_that_is_latched_from_before() -> None:
    async with mock_bus() as rig:
        for servo_id in (2, 4):
            rig.servo(servo_id).motor.power(on=True)
            rig.fault(FaultKind.OVERLOAD, servo_id)
        said = await refusal(rig)
    assert f"{XM} reports overload, latched from before: restart its power" in said
    assert f"{AX} reports overload, latched from before: restart its power" in said


async def test_one_error_names_all_that_is_missing_or_wrong() -> None:
    async with mock_bus(servos=servos(id1={"firmware": 30}, id6={"operating_mode": 5})) as rig:
        rig.fault(FaultKind.MISSING, 3)
        rig.fault(FaultKind.MISSING, 8)
        lines = (await refusal(rig)).splitlines()
    assert lines[0] == f"the arms on {rig.bus.path or lines[0].split()[3]} cannot be used:"
    assert [line.split()[0] for line in lines[1:]] == [
        "right.shoulder_pitch", "left.elbow_pitch", "right.elbow_roll", "left.claw",
    ]  # fmt: skip
    assert "right.elbow_roll (ID 3) does not answer at 1000000 bits/s: look at its cable" in lines[3]


async def test_missing_servos_are_looked_for_at_other_baud_rates_ids_and_protocols() -> None:
    elsewhere = servos(id1={"baud": 57_600}, id2={"model": "AX-12A"}, id3={"id": 12})
    async with mock_bus(servos=elsewhere) as rig:
        said = await refusal(rig)
    assert "(ID 1) does not answer at 1000000 bits/s: it answers at 57600, so set its Baud Rate" in said
    assert f"{XM} does not answer at 1000000 bits/s: AX-12A answers there by Protocol 1.0, and it should be" in said
    assert "ID 12 answers, XM430-W350, but no joint has that ID" in said


async def test_a_bus_without_power_names_every_joint() -> None:
    async with mock_bus() as rig:
        rig.fault(FaultKind.SILENT_BUS)
        assert (await refusal(rig)).count("does not answer") == 8


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


async def test_the_warning_reaches_whoever_opened_the_bus_and_is_theirs_to_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with mock_bus() as rig:
        device = tmp_path / Path(rig.bus.path).name
        device.mkdir()
        (device / "latency_timer").write_text("16")
        monkeypatch.setattr(latency_warning, "__defaults__", (tmp_path,))
        async with connected(rig) as bus:
            assert "latency timer is 16 ms" in bus.warnings[0]
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
