"""Demos that end before they take off: a silent room, and Ctrl-C while connecting. Own processes, wall-clock time."""

from pathlib import Path

import pytest

from companion.cli.demo.mock_process import free_ports, mock_process
from tests.flights.command import ROOT, mock_config, run, start

pytestmark = pytest.mark.realtime


async def test_motion_capture_silent_before_takeoff_is_one_sentence_and_a_safe_vehicle(tmp_path: Path) -> None:
    mock = mock_config(tmp_path, ("rate_hz = 100.0", "rate_hz = 100.0\nsilences = [{start_s = 3.0, for_s = 600.0}]"))
    ran = await run("demo", "--free-ports", "--mock-config", mock, "--out", tmp_path)
    assert ran.code == 1, ran.said
    assert "body seen" in ran.out or "mocap silent" in ran.out, "the preflight's check, or a little later the flight's"
    assert "The mocks run on this computer: it may have been too busy" in ran.out, "nobody asked for a fault"
    assert "takeoff" not in ran.out
    assert "the flight was ended" not in ran.out, "it had not begun"
    assert "Traceback" not in ran.said


async def test_ctrl_c_while_connecting_ends_at_once_and_in_order(tmp_path: Path) -> None:
    ports = free_ports()
    async with mock_process(ROOT / "config" / "mock.toml", 1, ports):
        config = tmp_path / "companion.toml"
        deaf = f"udpin://127.0.0.1:{free_ports().client}"  # nobody sends there: it would wait for an autopilot
        config.write_text(f'[mocap]\nport = {ports.qualisys}\n[px4]\nurl = "{deaf}"\nconnect_timeout_s = 60.0\n')
        running = await start("demo", "--no-mocks", "--config", config, "--out", tmp_path)
        await running.until_line("connecting")
        running.interrupt()
        ran = await running.ended()
    assert ran.code == 130, ran.said
    assert "interrupted" in ran.out
    assert "Traceback" not in ran.said
