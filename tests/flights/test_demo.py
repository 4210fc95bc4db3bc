"""Demo flights as a user starts them: own processes, real sockets, wall-clock time."""

import math
from pathlib import Path
from typing import Any

import pytest

from companion.records.read import read_flight
from tests.flights.command import mock_config, read_json, run, size_of_only, start

pytestmark = pytest.mark.realtime


async def test_a_demo_flight_tracks_lands_says_so_and_agrees_with_the_simulation(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    ran = await run("demo", "--free-ports", "--out", tmp_path, "--summary", summary)
    assert ran.code == 0, ran.said
    data = read_json(summary)
    assert data["trajectory"] == "ellipse"
    assert data["controller"] == "etnn"
    assert data["landed"] is True
    assert data["disarmed"] is True
    assert max(data["mean_error_m"]) <= 0.05
    assert max(data["max_error_m"]) <= 0.20
    assert 0.0 < data["update_share"] < 0.5, "the event trigger should have spared most of the updates"
    assert 3200 <= data["control_cycles"] <= 3600, "34 s of tracking at 100 Hz, frames and deadlines together"
    for timing in ("tick_late_ms", "frame_to_setpoint_ms"):
        assert set(data[timing]) == {"median", "p99"}
    assert size_of_only(tmp_path, "*-ellipse-etnn-seed1.png") > 20_000
    _has_a_whole_record(tmp_path)
    for phase in ("preflight", "armed", "takeoff", "hold", "track", "land", "disarmed"):
        assert phase in ran.out
    _agrees_with_the_simulation(data, await _simulated(tmp_path / "simulated.json"))


def _has_a_whole_record(folder: Path) -> None:
    record = read_flight(next(folder.glob("*-ellipse-etnn-seed1.mcap")))
    assert (record.truncated, record.dropped) == (False, 0)
    assert (record.metadata["trajectory"], record.columns["phase"][-1]) == ("ellipse", "disarmed")


async def _simulated(summary: Path) -> dict[str, Any]:
    """Simulate that flight and return the summary."""
    ran = await run("simulate", "--demo", "--seeds", "1:8", "--summary", summary)
    assert ran.code == 0, ran.said
    return read_json(summary)


def _agrees_with_the_simulation(flown: dict[str, Any], simulated: dict[str, Any]) -> None:
    """The norm of the axes' means, to 20 %: when an event comes is chance, in real time, and moves it by some 5 %."""
    assert math.hypot(*flown["mean_error_m"]) == pytest.approx(simulated["error_m"], rel=0.2), simulated["mean_error_m"]


async def test_motion_capture_silent_before_takeoff_is_one_sentence_and_a_safe_vehicle(tmp_path: Path) -> None:
    mock = mock_config(tmp_path, ("rate_hz = 100.0", "rate_hz = 100.0\nsilences = [{start_s = 3.0, for_s = 600.0}]"))
    ran = await run("demo", "--free-ports", "--mock-config", mock, "--out", tmp_path)
    assert ran.code == 1, ran.said
    assert "body seen" in ran.out or "mocap silent" in ran.out, "the preflight's check, or a little later the flight's"
    assert "The mocks run on this computer: it may have been too busy" in ran.out, "nobody asked for a fault"
    assert "takeoff" not in ran.out
    assert "the flight was ended" not in ran.out, "it had not begun"
    assert "Traceback" not in ran.said


async def test_a_body_that_is_not_seen_is_not_armed(tmp_path: Path) -> None:
    mock = mock_config(tmp_path, ("rate_hz = 100.0", "rate_hz = 100.0\noutages = [{start_s = 0.0, for_s = 600.0}]"))
    ran = await run("demo", "--free-ports", "--mock-config", mock, "--out", tmp_path)
    assert ran.code == 1, ran.said
    assert "is not seen by motion capture" in ran.out
    assert "armed" not in ran.out.replace("disarmed", "")


async def test_ctrl_c_lands(tmp_path: Path) -> None:
    running = await start("demo", "--free-ports", "--out", tmp_path, "--summary", tmp_path / "summary.json")
    await running.until_line("hold")
    running.interrupt()
    ran = await running.ended()
    assert ran.code == 130, ran.said
    assert "interrupted: landing" in ran.out
    assert "disarmed" in ran.out
    assert "Traceback" not in ran.said
