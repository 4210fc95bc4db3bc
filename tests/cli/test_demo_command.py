"""`companion demo`: what it takes and says besides flying, which tests/flights does."""

import asyncio
import io
import math
import os
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from companion.analysis.summary import Spread, Summary
from companion.cli.demo.command import _say_next
from companion.cli.demo.flight_report import print_report
from companion.cli.demo.ground_process import Radio, newest_record
from companion.cli.demo.progress import FlightDisplay
from companion.cli.output import kept
from companion.config.controller_config import ErrorLimits, LoadedController, load_controller
from companion.control.controller import VehicleModel
from companion.core.types import Reference
from companion.records.recorder import Recorder
from companion.supervisor.flight_state import Phase
from tests.cli.typed import disk_full_after, typing
from tests.records.test_recorder import tick

TIMING = Spread(1.0, 2.0)
FLOWN = Summary(
    mean_error_m=(0.01,) * 3,
    max_error_m=(0.02,) * 3,
    rms_error_m=(0.01,) * 3,
    update_share=0.1,
    control_cycles=1000,
    tick_late_ms=TIMING,
    frame_to_setpoint_ms=TIMING,
    capture_to_setpoint_ms=TIMING,
    cycles_without_frame=0,
    landed=True,
    disarmed=True,
)


def report(controller: LoadedController, summary: Summary | None, failure: str = "") -> str:
    console = Console(file=io.StringIO(), width=100)
    print_report(console, controller, summary, failure, False)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_the_live_line_tells_error_and_updates_in_a_narrow_terminal() -> None:
    display = FlightDisplay(Console(file=io.StringIO(), width=80), "figure8", "practical")
    at = Reference(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)
    for number, phase in enumerate([Phase.TAKEOFF, *[Phase.HOLD] * 4]):
        one = tick(number, seen=True)
        display.take(replace(one, flight=replace(one.flight, phase=phase), reference=at))
    line = display._line()
    assert "error +400.0  +0.0 +100.0 cm  updates" in line.plain[:80]
    assert "figure8, practical" in line.plain
    assert line.overflow == "ellipsis"


def test_what_can_be_done_next_is_said_of_all_flights_together() -> None:
    console = Console(file=io.StringIO(), width=80)
    _say_next([Path("flights/a.mcap"), Path("flights/b.mcap")], console)
    _say_next([], console)
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().splitlines() == [
        "next: companion report flights/a.mcap flights/b.mcap",
        "      or open the record in Foxglove: docs/records.md",
    ]


def test_an_unstable_controller_is_taken_when_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = typing("demo", monkeypatch, capsys)
    wrong_too = ("--controller", "paper", "--out", tmp_path, "--summary", tmp_path)
    assert "must be larger than k + s" in typed(*wrong_too).err
    taken = typed("--allow-unstable", *wrong_too)
    assert taken.code == 2
    assert taken.err.strip().endswith("is a folder: give the name of a file"), "and nothing flies"


def test_the_report_says_what_the_controller_says_of_itself() -> None:
    baseline = load_controller("pid", VehicleModel(), 0.01)
    assert "pid: the paper's baseline\n" in report(baseline, FLOWN)
    assert "the paper's baseline" not in report(baseline, None), "nothing was flown"
    silent = LoadedController("mine", baseline.law, ErrorLimits(), "")
    assert "mine:" not in report(silent, FLOWN)


@pytest.mark.parametrize(
    ("mean_m", "verdict"), [(0.05, "inside the error limits"), (math.nextafter(0.05, 1.0), "outside the error limits")]
)
def test_the_verdict_is_on_the_worst_axis(mean_m: float, verdict: str) -> None:
    flown = replace(FLOWN, mean_error_m=(0.01, mean_m, 0.01))
    law = load_controller("pid", VehicleModel(), 0.01).law
    assert verdict in report(LoadedController("mine", law, ErrorLimits(mean_m=0.05, max_m=0.2)), flown)


async def test_faults_of_the_network_reach_the_relay_once_it_is_there_and_others_do_not() -> None:
    ours, theirs = socket.socketpair()
    with theirs:
        _, relay = await asyncio.open_connection(sock=ours)
        radio = Radio()
        for fault in ("network off for 0.3 s", "mocap off"):
            radio.begin(fault)
        radio.open(relay)
        radio.begin("network delayed by 0.05 s")
        await relay.drain()
        assert theirs.recv(100) == b"fault network off for 0.3 s\nfault network delayed by 0.05 s\n"
        relay.close()
        await relay.wait_closed()


def test_a_reason_is_printed_as_it_is() -> None:
    law = load_controller("pid", VehicleModel(), 0.01)
    assert "real-time: set [preflight] realtime = false\n" in report(
        law, None, "real-time: set [preflight] realtime = false"
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--fault", "broker off at 3 s"),
            '--fault "broker off at 3 s": no broker is listened to: the configuration has',
        ),
        (
            ("--fault", "network off at 3 s"),
            '--fault "network off at 3 s": with the law on board there is no such network: give --law-on ground',
        ),
        (
            ("--config", "config/mock.toml"),
            "config/mock.toml: this is the mock's configuration; give the companion's, ",
        ),
        (("--out", "FULL"), "cannot write to FULL: File too large"),
        (("--trajectory", "NEAR"), "fence around the trajectory: 0.50 m inside, and braking would end 0.19 m inside"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_said(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    files = {name: str(tmp_path / name.lower()) for name in ("FULL", "NEAR")}
    Path(files["NEAR"]).write_text("t_s,x_m,y_m,z_m\n0,0,0,1.2\n4,4,0,1.2\n")
    with disk_full_after(1000 if "FULL" in arguments else -1):
        refused = typing("demo", monkeypatch, capsys)(*(files.get(one, one) for one in arguments))
    assert (refused.code, refused.out) == (2, "")
    assert sentence.replace("FULL", files["FULL"]) in refused.err
    assert len(refused.err.splitlines()) == 1


def test_a_record_that_cannot_be_written_is_a_sentence_and_leaves_no_half_of_it(tmp_path: Path) -> None:
    recorder, path = Recorder(), tmp_path / "record.npz"
    for number in range(2000):
        recorder(tick(number, seen=True))
    with disk_full_after(2000):
        assert kept(path, recorder.write) == f"cannot write to {path}: File too large"
    assert not list(tmp_path.iterdir())
    assert kept(path, recorder.write) == ""
    assert path.exists()


def test_the_grounds_record_is_the_newest_with_the_flights_name(tmp_path: Path) -> None:
    assert newest_record(tmp_path, "ellipse-etnn-seed1") is None
    names = ("1-ellipse-etnn-seed1-ground-9", "2-ellipse-etnn-seed1-ground-3", "3-ellipse-pid-seed1-ground-4")
    for number, name in enumerate((*names, "4-ellipse-etnn-seed1")):
        path = tmp_path / f"{name}.mcap"
        path.touch()
        os.utime(path, (number, number))
    assert newest_record(tmp_path, "ellipse-etnn-seed1") == tmp_path / f"{names[1]}.mcap"


@pytest.mark.realtime
def test_a_fault_that_is_none_ends_the_demo_before_anything_flies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = typing("demo", monkeypatch, capsys)
    wrong = typed("--free-ports", "--out", tmp_path, "--fault", "mocap off at 3 s", "--fault", "mocap stuk at 3 s")
    assert wrong.code == 2
    assert wrong.err.strip() == (
        'companion: --fault "mocap stuk at 3 s": mocap cannot be "stuk"; '
        'it can be off, stuck, garbage, wrong, slow, delayed, intermittent; did you mean "mocap stuck"?'
    )
    assert "connecting" not in wrong.out
    assert not list(tmp_path.iterdir())


def test_mocks_that_run_already_are_given_no_faults(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    refused = typing("demo", monkeypatch, capsys)("--no-mocks", "--fault", "mocap off at 3 s")
    assert (refused.code, refused.out) == (2, "")
    assert refused.err.startswith("companion: --fault is for the mocks that the demo starts")


def test_the_demos_help_shows_faults_by_example(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = typing("demo", monkeypatch, capsys)("--help").out
    assert "--fault" in shown
    assert "docs/faults.md" in shown
