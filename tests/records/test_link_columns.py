"""Columns of the link to a law on the ground: stamps of both sides, counts, and the command in use."""

import numpy as np
import pytest

from companion.analysis.summary import summarise
from companion.law_link.messages import TICK_S
from companion.records.read import FlightRecord, read_flight
from companion.records.recorder import Recorder
from companion.records.split.link_columns import ACCEL, NUMBERS
from companion.supervisor.flight_state import Phase
from tests.records.linked import DOWN_S, GROUND_AHEAD_S, UP_S, flight_with_link
from tests.records.test_round_trip import written


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    (path,) = written(tmp_path_factory.mktemp("records"), flight_with_link())
    return read_flight(path)


def test_every_cycle_has_the_link_also_before_the_law_flies(record: FlightRecord) -> None:
    for name in (*NUMBERS, ACCEL):
        assert len(record.columns[name]) == len(record.columns["time_s"]), name
    assert record.columns["link_connected"].all()
    assert len(set(record.columns["link_session"])) == 1
    assert set(record.columns["law_name"]) == {"etnn on the ground"}


def test_a_command_has_the_stamps_of_both_sides(record: FlightRecord) -> None:
    c = record.columns
    known = np.isfinite(c["link_command_arrived_s"]) & np.isfinite(c["link_clock_offset_s"])
    assert known.sum() > 30
    off_s = 0.5 * (UP_S - DOWN_S)  # as long as both ways are not equally long
    np.testing.assert_allclose(c["link_clock_offset_s"][known], off_s - GROUND_AHEAD_S, atol=2 * TICK_S)
    on_way_s = c["link_command_arrived_s"] - c["link_command_sent_s"]
    np.testing.assert_allclose(on_way_s[known], UP_S - off_s, atol=3 * TICK_S)
    sent_s = c["link_command_sent_ground_s"] - GROUND_AHEAD_S
    np.testing.assert_allclose(c["link_command_arrived_s"][known] - sent_s[known], UP_S, atol=2 * TICK_S)
    np.testing.assert_allclose(c["link_capture_ago_s"][known], 0.012, atol=1e-12)
    assert (c["link_message_arrived_s"][known] >= c["link_command_arrived_s"][known]).all()


def test_the_command_in_use_is_what_the_ground_wanted(record: FlightRecord) -> None:
    c = record.columns
    used = c["link_command"] > 0
    assert used.sum() > 30
    np.testing.assert_array_equal(c[ACCEL][used][:, :2], np.broadcast_to([0.25, -0.5], (used.sum(), 2)))
    assert (np.diff(c[ACCEL][used][:, 2]) >= 0.0).all()
    assert (c["link_yaw_rad"][used] == 0.125).all()
    assert np.isnan(c["link_yaw_rad"][~used]).all()


def test_messages_are_counted_by_their_kind(record: FlightRecord) -> None:
    last = {name: float(record.columns[name][-1]) for name in NUMBERS}
    assert last["link_events"] == record.columns["link_command"].max() > 5
    assert last["link_messages"] == last["link_events"] + last["link_again"] + last["link_beats"]
    assert last["link_lost"] == 0
    assert last["link_messages_received"] == last["link_messages"]
    assert last["link_bytes_received"] > 20 * last["link_messages"]
    assert last["link_messages_down"] > 10
    assert last["link_bytes_down"] > 20 * last["link_messages_down"]


def test_the_recorder_in_memory_has_them_too(record: FlightRecord) -> None:
    recorder = Recorder()
    for tick in flight_with_link():
        if tick.flight.phase is not Phase.STANDBY:
            recorder(tick)
    for name in (*NUMBERS, ACCEL):
        np.testing.assert_array_equal(recorder.arrays()[name], record.columns[name], name)


def test_the_summary_has_the_links_messages_and_ages() -> None:
    recorder = Recorder()
    for tick in flight_with_link():
        recorder(tick)
    summary = summarise(recorder.arrays())
    assert summary is not None
    assert summary.link is not None
    assert summary.link.age_ms.median == pytest.approx(1e3 * 0.5 * (UP_S + DOWN_S), abs=0.3)
    assert summary.link.events == 7
    assert 30.0 < summary.link.messages_per_s < 50.0
    assert summary.link.lost == 0
