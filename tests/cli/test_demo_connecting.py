"""A demo that is ended while it connects: own processes, real sockets, wall-clock time."""

from pathlib import Path

import pytest

from companion.cli.demo.mock_process import free_ports, mock_process
from tests.flights.command import ROOT, start

pytestmark = pytest.mark.realtime


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
