"""Mistakes that a user can mend: one sentence and an exit code, and never a traceback or a hang."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.cli.demo.mock_process import free_ports
from tests.flights.command import ROOT, mock_config, run
from tests.warm import mock_process

pytestmark = pytest.mark.realtime


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--config", "CONFIG"], "vehicle.mas_kg: unknown key, did you mean 'mass_kg'?"),
        (["--config", "RANGE"], "limits.max_tilt_rad = 3.0"),
        (["--config", "nowhere.toml"], "nowhere.toml: there is no such file"),
        (["--trajectory", "circle"], "unknown trajectory 'circle': give ellipse or figure8"),
        (["--trajectory", "nowhere.csv"], "nowhere.csv: there is no such file"),
        (["--controller", "lqr"], "unknown controller 'lqr'"),
        (["--controller", "paper"], "0.333 must be larger than k + s = 16.1"),
        (["--mock-config", "nowhere.toml"], "nowhere.toml"),
        (["--summary", "FOLDER"], "is a folder: give the name of a file"),
        (["--size", "3", "--period", "4"], "ellipse: too fast"),
        (["--trajectory", "FAR"], "leaves the room: x = 100.00 m"),
        (["--trajectory", "FLOOR"], "leaves the room: z = "),
        (["--trajectory", "LEAP"], "way.csv: leaves the room"),
    ],
)
async def test_a_mistake_is_one_sentence(tmp_path: Path, arguments: list[str], sentence: str) -> None:
    files = {
        "CONFIG": _write(tmp_path / "config.toml", "[vehicle]\nmas_kg = 4.85\n"),
        "FOLDER": tmp_path,
        "FAR": _write(tmp_path / "far.csv", "t_s,x_m,y_m,z_m\n0,100,0,1\n9,100,0,1\n"),
        "FLOOR": _write(tmp_path / "floor.csv", "t_s,x_m,y_m,z_m\n0,0,0,1\n9,0,0,-1\n"),
        "LEAP": _write(tmp_path / "way.csv", "t_s,x_m,y_m,z_m\n0,0,0,1\n0.1,3,0,1\n10,0,0,1\n"),
        "RANGE": _write(tmp_path / "range.toml", "[limits]\nmax_tilt_rad = 3.0\n"),
    }
    ran = await run("demo", "--out", tmp_path, *(files.get(word, word) for word in arguments))
    assert ran.code == 2, ran.said
    assert sentence in ran.err
    assert "Traceback" not in ran.said
    assert len(ran.err.strip().splitlines()) == 1


async def _refused(tmp_path: Path, config: str, sentence: str) -> None:
    path = _write(tmp_path / "companion.toml", config)
    ran = await run("demo", "--no-mocks", "--config", path, "--out", tmp_path)
    assert ran.code == 2, ran.said
    assert sentence in ran.err
    assert "Traceback" not in ran.said


async def test_no_mocap_server_says_what_to_start(tmp_path: Path) -> None:
    port = free_ports().qualisys
    await _refused(tmp_path, f"[mocap]\nport = {port}\n", f"no QTM at 127.0.0.1:{port}")


async def test_a_body_that_qtm_does_not_know_names_those_it_has(tmp_path: Path) -> None:
    ports = free_ports()
    mock = mock_config(tmp_path, ('body = "dauam"', 'body = "dauam"\nextra_bodies = ["wand"]'))
    async with mock_process(mock, 1, ports):
        config = f'[mocap]\nport = {ports.qualisys}\nbody = "drone"\n'
        await _refused(tmp_path, config, "does not know the body 'drone'; it has: dauam, wand")


async def test_no_autopilot_says_where_it_listened(tmp_path: Path) -> None:
    ports, elsewhere = free_ports(), free_ports()
    async with mock_process(ROOT / "config" / "mock.toml", 1, ports):
        url = f"udpin://127.0.0.1:{elsewhere.client}"
        config = f'[mocap]\nport = {ports.qualisys}\n[px4]\nurl = "{url}"\nconnect_timeout_s = 2.0\n'
        await _refused(tmp_path, config, f"no autopilot heard on {url} within 2 s")


@contextmanager
def _taken_udp_port() -> Iterator[int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        yield taken.getsockname()[1]


async def test_a_port_in_use_is_named(tmp_path: Path) -> None:
    ports = free_ports()
    async with mock_process(ROOT / "config" / "mock.toml", 1, ports):
        with _taken_udp_port() as port:
            config = f'[mocap]\nport = {ports.qualisys}\n[px4]\nurl = "udpin://127.0.0.1:{port}"\n'
            await _refused(tmp_path, config, f"cannot open udpin://127.0.0.1:{port}")
