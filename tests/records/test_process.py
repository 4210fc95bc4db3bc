"""The writer's process: what is killed leaves a record, and nothing that happens to it disturbs the flight."""

import errno
import itertools
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil  # type: ignore[import-untyped]
import pytest
from websockets.sync.client import connect

from companion.cli.demo.mock_process import free_ports
from companion.config.records_config import RecordsConfig
from companion.records.read import RecordError, read_flight
from companion.records.record_process import RecordSink
from tests.flights.command import ROOT
from tests.records.flown import flight
from tests.records.writer_process import wait_until_it_reads

pytestmark = pytest.mark.slow


@contextmanager
def recording(folder: Path, **config: Any) -> Iterator[RecordSink]:
    settings = {"folder": str(folder), "live_port": 0, "min_free_mb": 0.0} | config
    sink = RecordSink(RecordsConfig.model_validate(settings), "one")
    try:
        wait_until_it_reads(sink)
        yield sink
    finally:
        sink.close()


def feed(sink: RecordSink, after: Callable[[int], None] = lambda _: None, **how: Any) -> int:
    """Feed a flight at several times its speed and return the number of its ticks."""
    count = 0
    for count, tick in enumerate(flight(**how), 1):
        sink(tick)
        after(count)
        time.sleep(0.002)
    return count


def until(true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_service_and_writer_killed_leave_a_record_up_to_the_last_second(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.records.feeder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as service:
        assert service.stdout is not None
        writer, number = int(service.stdout.readline()), 0
        while number < 300:
            number = int(service.stdout.readline())
        os.kill(service.pid, signal.SIGKILL)
        os.kill(writer, signal.SIGKILL)
        for line in service.stdout:
            number = int(line)
    (path,) = tmp_path.glob("*.mcap")
    record = read_flight(path)
    assert record.truncated
    assert record.columns["tick"][-1] >= number - 100
    assert record.dropped == 0
    assert record.first_estimate is not None


def test_signals_do_not_end_the_writer_and_the_end_of_the_service_closes_the_file(tmp_path: Path) -> None:
    def interrupt(count: int) -> None:
        if count == 30:
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                os.kill(sink.pid or 0, number)

    with recording(tmp_path) as sink:
        sink.begin({"seed": 5})
        count = feed(sink, interrupt)
        sink.tell("command", "land", 100.5)
    record = read_flight(next(tmp_path.glob("*.mcap")))
    assert not record.truncated
    assert len(record.columns["time_s"]) == count - 10  # all but standby
    assert record.metadata["seed"] == 5
    assert [event.text for event in record.events] == ["land"]
    assert sink.dropped == 0


def has_a_tick(folder: Path) -> bool:
    """The writer has come to the first row."""
    try:
        return all(len(read_flight(path).columns["tick"]) > 0 for path in folder.glob("*.mcap"))
    except RecordError:
        return False


def test_a_writer_that_dies_is_told_of_and_is_there_again_for_the_next_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.records.record_process._AGAIN_S", 0.0)

    def kill(count: int) -> None:
        if count == 30:
            until(lambda: has_a_tick(tmp_path) and any(tmp_path.glob("*.mcap")))
            os.kill(sink.pid or 0, signal.SIGKILL)

    with recording(tmp_path) as sink:
        feed(sink, kill, after_s=0.0)
        was_alive = sink.alive
        assert not was_alive
        assert "has ended" in (sink.failed or "")
        assert sink.dropped > 0
        sink(next(flight(start_s=1e9)))  # standby: it is started again
        assert sink.alive
        wait_until_it_reads(sink)
        assert not sink.failed
        feed(sink, start_s=1e9)
    whole = [read_flight(path) for path in sorted(tmp_path.glob("*.mcap"))]
    assert [record.truncated for record in whole][-1] is False
    assert whole[-1].dropped == 0


def test_a_full_disk_ends_the_writing_once_and_not_the_flight(tmp_path: Path) -> None:
    with recording(tmp_path) as sink:
        _, most = resource.prlimit(sink.pid or 0, resource.RLIMIT_FSIZE)
        resource.prlimit(sink.pid or 0, resource.RLIMIT_FSIZE, (60_000, most))
        feed(sink, track_s=3.0)
        until(lambda: bool(sink.failed) or feed(sink, track_s=0.2, start_s=1e6) < 0)
        assert os.strerror(errno.EFBIG) in (sink.failed or "")
        assert sink.alive
        assert sink.dropped == 0
    record = read_flight(min(tmp_path.glob("*.mcap")))
    assert record.truncated
    assert len(record.columns["time_s"]) >= 50


def test_a_writer_that_is_kept_waiting_catches_up_without_a_gap(tmp_path: Path) -> None:
    def stop_and_go(count: int) -> None:
        if count in {15, 600}:
            os.kill(sink.pid or 0, signal.SIGSTOP if count == 15 else signal.SIGCONT)

    with recording(tmp_path) as sink:
        count = feed(sink, stop_and_go, track_s=6.5)
        assert sink.dropped == 0
    record = read_flight(next(tmp_path.glob("*.mcap")))
    assert (record.dropped, len(record.columns["time_s"])) == (0, count - 10)


def test_a_writer_that_does_not_keep_up_is_told_of_once_and_the_gap_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("companion.records.record_process._MOST_BACKLOG", 3)
    monkeypatch.setattr("companion.records.record_process._BUFFER", 200_000)

    event: list[int] = []

    def stop_and_go(count: int) -> None:
        if count == 50:
            os.kill(sink.pid or 0, signal.SIGSTOP)
        elif count == 500:
            event.append(caplog.text.count("does not keep up"))
            os.kill(sink.pid or 0, signal.SIGCONT)

    with recording(tmp_path) as sink:
        feed(sink, stop_and_go, track_s=7.5)
        assert sink.dropped > 0
        assert "does not keep up" in (sink.failed or "")
        assert event == [1]
    record = read_flight(next(tmp_path.glob("*.mcap")))
    assert record.dropped > 0


def test_a_message_that_is_too_large_for_the_system_is_lost_alone(tmp_path: Path) -> None:
    with recording(tmp_path) as sink:
        feed(sink)
        sink.tell("reply", "x" * 20_000_000, 100.5)
        until(lambda: bool(sink.failed) or sink.tell("log", "more", 100.6) is not None)  # type: ignore[func-returns-value]
        assert "too large" in (sink.failed or "")
        assert sink.alive
        count = feed(sink, start_s=1e9)
    record = read_flight(max(tmp_path.glob("*.mcap"), key=lambda path: path.stat().st_mtime))
    assert (record.dropped, len(record.columns["time_s"])) == (0, count - 10)


def test_too_little_space_is_told_and_nothing_is_written(tmp_path: Path) -> None:
    with recording(tmp_path, min_free_mb=1e7) as sink:
        feed(sink)
        until(lambda: bool(sink.failed) or feed(sink) < 0)
        assert "this flight is not recorded" in (sink.failed or "")
    assert not list(tmp_path.glob("*.mcap"))


def test_whoever_watches_live_gets_all_topics(tmp_path: Path) -> None:
    port = free_ports().client
    assert port is not None
    with recording(tmp_path, live_port=port) as sink:
        feed(sink)
        with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], close_timeout=0.2) as watcher:  # type: ignore[list-item]
            topics: dict[str, int] = {}
            while "/law" not in topics or "/scene" not in topics:
                said = json.loads(watcher.recv(timeout=20.0))
                topics |= {channel["topic"]: channel["id"] for channel in said.get("channels", ())}
            subscription = {"id": 1, "channelId": topics["/estimate"]}
            watcher.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
            time.sleep(0.2)
            for standby in itertools.islice(flight(start_s=300.0), 10):
                sink(standby)
            message = watcher.recv(timeout=20.0)
            assert isinstance(message, bytes)
            assert json.loads(message[13:])["position_w_m"][2] == pytest.approx(1.0, abs=0.01)
    assert {"/flight", "/mocap", "/estimate", "/reference", "/given", "/setpoint", "/arms", "/tf"} <= set(topics)


def test_a_port_that_is_taken_is_told_and_the_flight_recorded(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    port = free_ports().client
    assert port is not None
    with recording(tmp_path / "first", live_port=port), recording(tmp_path / "second", live_port=port) as sink:
        feed(sink)
        assert f"nothing to watch on 127.0.0.1:{port}" in caplog.text
        assert sink.file
    assert list((tmp_path / "second").glob("*.mcap"))


def test_the_writer_does_not_outlive_a_service_that_is_gone(tmp_path: Path) -> None:
    with recording(tmp_path) as sink:
        writer = psutil.Process(sink.pid)
    assert not writer.is_running()
