"""Records of both sides of a flight by a law on the ground: replayed to the last bit, and merged into one."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner, Result

from companion.analysis.replay.laws import LawKey, config_of, laws_of
from companion.analysis.replay.rerun import Replayed, replay
from companion.cli.commands import app
from companion.core.errors import CompanionError
from companion.flight.tick import Tick
from companion.ground.ground_record import GroundRecorder
from companion.records.errors import RecordError
from companion.records.flight_record import FlightRecord
from companion.records.read import read_flight
from companion.records.split.merge import joined, merge
from companion.supervisor.flight_state import Phase
from tests.ground.recorded_flight import CONFIG, RADIO, BothSides, both_sides
from tests.records.flown import flight as flight_on_board
from tests.records.test_round_trip import written

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sides(tmp_path_factory: pytest.TempPathFactory) -> BothSides:
    return both_sides(tmp_path_factory.mktemp("flight"))


@pytest.fixture(scope="module")
def vehicle(sides: BothSides) -> FlightRecord:
    return read_flight(sides.vehicle)


@pytest.fixture(scope="module")
def ground(sides: BothSides) -> FlightRecord:
    return read_flight(sides.ground)


@pytest.fixture(scope="module")
def merged(sides: BothSides, tmp_path_factory: pytest.TempPathFactory) -> Path:
    into = tmp_path_factory.mktemp("merged") / "both.mcap"
    merge(sides.vehicle, sides.ground, into)
    return into


def again(record: FlightRecord) -> Replayed:
    config = config_of(record)
    return replay(record, config, laws_of(record, config))


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def changed(record: FlightRecord, **columns: Any) -> FlightRecord:
    return replace(record, columns=record.columns | columns)


def test_the_vehicle_does_again_what_it_did_with_the_commands_that_came(vehicle: FlightRecord) -> None:
    assert vehicle.columns["link_lost"].max() > 50, "the radio loses"
    assert set(vehicle.columns["link_law"]) == {0.0, 1.0}, "the law was changed once"
    done = again(vehicle)
    assert done.identical, [one for one in done.differences.values() if one.differ]
    for name in ("command", "setpoint attitude", "setpoint thrust", "sent attitude", "estimate position_w_m"):
        assert done.differences[name].compared > 500, name
    assert done.events[0] == done.events[1] > 50


def test_another_command_of_the_ground_shows_in_the_setpoint(vehicle: FlightRecord) -> None:
    accel = vehicle.columns["link_accel_w_mps2"].copy()
    row = int(np.flatnonzero(vehicle.columns["event"])[20])
    accel[row] += 1e-3
    done = again(changed(vehicle, link_accel_w_mps2=accel))
    assert done.differences["command"].differ == 1
    assert done.differences["setpoint thrust"].differ > 0
    assert done.differences["estimate position_w_m"].differ == 0


def test_the_ground_computes_again_what_it_did_also_where_another_law_took_over(ground: FlightRecord) -> None:
    assert ground.laws == ("etnn", "pid")
    done = again(ground)
    assert done.identical, [one for one in done.differences.values() if one.differ]
    for name in ("command", "setpoint attitude", "law x1", "estimate velocity_w_mps"):
        assert done.differences[name].compared > 500, name
    for name in ("law f_hat", "law v0", "law kappa", "law integral_mps2"):
        assert done.differences[name].compared > 50, name
    assert done.events[0] == done.events[1] > 50
    assert "sent attitude" not in done.differences, "the autopilot is the vehicle's"


def test_a_law_is_replayed_for_the_age_of_commands_that_it_was_made_for(ground: FlightRecord) -> None:
    config = config_of(ground)
    (age_s,) = {key.up_age_s for key in laws_of(ground, config)}
    assert 0.003 < age_s < 0.03
    assert LawKey("etnn", age_s) in laws_of(ground, config)
    done = again(changed(ground, link_made_for_s=ground.columns["link_made_for_s"] + 0.02))
    assert done.differences["command"].differ > 0


def test_another_setpoint_that_the_ground_took_for_sent_shows(ground: FlightRecord) -> None:
    done = again(changed(ground, mirror_thrust=ground.columns["mirror_thrust"] + 0.2))
    assert done.differences["setpoint thrust"].differ > 0
    assert done.differences["command"].differ > 0, "the law was told what was sent last"


def test_a_key_that_is_not_on_this_computer_is_no_obstacle(vehicle: FlightRecord) -> None:
    law = vehicle.metadata["config"]["law"]
    assert law["runs_on"] == "ground"
    elsewhere = law | {"link": law["link"] | {"key_file": "/nowhere/key"}}
    moved = replace(vehicle, metadata=vehicle.metadata | {"config": vehicle.metadata["config"] | {"law": elsewhere}})
    config = config_of(moved)
    assert config.law.on_ground
    assert config.law.link.key_file is None


def test_both_records_are_listed_and_replayed_by_the_command(sides: BothSides) -> None:
    for path, law in ((sides.vehicle, "etnn on the ground"), (sides.ground, "etnn, pid")):
        (line,) = json.loads(run("records", path.parent, "--json").stdout)
        assert law in line["law"]
        assert line["ended"].startswith("disarmed")
        said = run("replay", path)
        assert said.exit_code == 0, said.output
        assert "identical to the last bit" in said.output


def test_another_law_can_be_given_what_the_ground_was_given(sides: BothSides) -> None:
    said = run("replay", sides.ground, "--controller", "practical", "--json")
    assert said.exit_code == 0, said.output
    assert json.loads(said.stdout)["flown"] > 500


def test_the_ground_s_record_has_its_frames_and_its_side_of_the_link(ground: FlightRecord) -> None:
    c = ground.columns
    assert np.isfinite(c["frame_stamp_s"]).sum() > 500
    flying = c["link_flying"]
    assert flying.sum() > 500
    assert (c["link_number"][flying] >= c["link_acknowledged"][flying]).all()
    np.testing.assert_allclose(c["link_clock_offset_s"][flying], -RADIO.clock_offset_s, atol=0.01)
    np.testing.assert_array_equal(c["airborne"], flying)
    assert c["phase"][-1] == Phase.DISARMED
    errors = np.linalg.norm(c["position_w_m"] - c["reference_position_w_m"], axis=1)[flying]
    assert np.nanmedian(errors) < 0.1, "the reference is that of the same time"


def test_a_merged_record_has_both_sides_on_the_vehicles_clock(merged: Path, ground: FlightRecord) -> None:
    record = read_flight(merged)
    assert record.ground is not None
    offset_s = record.ground.metadata["clock_offset_s"]
    assert offset_s == pytest.approx(-RADIO.clock_offset_s, abs=0.01)
    np.testing.assert_allclose(record.ground.columns["time_s"], ground.columns["time_s"] + offset_s, atol=1e-9)
    np.testing.assert_array_equal(record.ground.columns["accel_w_mps2"], ground.columns["accel_w_mps2"])
    begun = record.columns["time_s"][record.columns["airborne"]][0]
    assert record.ground.columns["time_s"][record.ground.columns["airborne"]][0] == pytest.approx(begun, abs=0.15)
    assert again(record).identical


def test_the_laws_signals_are_there_in_the_vehicles_cycles(merged: Path) -> None:
    record = read_flight(merged)
    assert record.ground is not None
    flown = np.isfinite(record.columns["law_x1"][:, 0])
    assert flown.sum() > 500
    row = int(np.flatnonzero(flown)[300])
    newest = np.searchsorted(record.ground.columns["time_s"], record.columns["time_s"][row], side="right") - 1
    np.testing.assert_array_equal(record.columns["law_x1"][row], record.ground.columns["law_x1"][newest])
    assert np.isfinite(record.columns["law_f_hat"]).any()


def test_a_damaged_side_of_the_ground_leaves_the_vehicles_flight(merged: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mcap"
    with merged.open("rb") as file, damaged.open("wb") as to:
        writer = Writer(to)
        writer.start()
        known = {topic: writer.register_channel(topic, "json", 0) for topic in ("/flight", "/ground/law")}
        for _, channel, message in make_reader(file).iter_messages([*known]):
            writer.add_message(known[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    record = read_flight(damaged)
    assert record.ground is None
    assert record.damage.startswith("no readable cycle of the ground")
    assert len(record.columns["time_s"]) > 500


def test_both_sides_are_written_as_tables(merged: Path, ground: FlightRecord, tmp_path: Path) -> None:
    said = run("records", merged, "--csv", tmp_path)
    assert said.exit_code == 0, said.output
    with (tmp_path / "ground_ticks.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(ground.columns["time_s"])
    np.testing.assert_array_equal(
        [float(row["accel_w_mps2_0"] or "nan") for row in rows], ground.columns["accel_w_mps2"][:, 0]
    )
    with (tmp_path / "ticks.csv").open(encoding="utf-8", newline="") as file:
        assert {"law_x1_0", "link_command_age_s"} <= set(next(csv.reader(file)))


def test_other_programs_find_the_grounds_topics_beside_the_vehicles(merged: Path) -> None:
    with merged.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/flight", "/link", "/scene", "/ground/law", "/ground/given", "/ground/link", "/ground/flight"} <= topics
    assert not {"/ground/scene", "/ground/tf", "/ground/autopilot"} & topics


def test_the_command_merges_beside_the_vehicles_record(sides: BothSides, tmp_path: Path) -> None:
    (vehicle, ground) = (tmp_path / "flight.mcap", tmp_path / "flight-ground.mcap")
    vehicle.write_bytes(sides.vehicle.read_bytes())
    ground.write_bytes(sides.ground.read_bytes())
    said = run("records", "merge", vehicle, ground)
    assert said.exit_code == 0, said.output
    assert "messages of the ground, whose clock is +1234.5" in said.output
    lines = {Path(line["path"]).name: line for line in json.loads(run("records", tmp_path, "--json").stdout)}
    assert lines["flight-merged.mcap"]["law"] == lines["flight.mcap"]["law"] == "etnn on the ground"
    assert lines["flight-merged.mcap"]["ended"] == lines["flight.mcap"]["ended"]


def test_what_are_not_two_sides_of_a_flight_is_refused_in_one_sentence(
    vehicle: FlightRecord, ground: FlightRecord, merged: Path, tmp_path: Path
) -> None:
    (on_board,) = written(tmp_path, flight_on_board())
    later = changed(ground, time_s=ground.columns["time_s"] + 600.0)
    other = changed(ground, link_session=np.full(len(later.columns["time_s"]), 1.0))
    deaf = changed(ground, link_clock_offset_s=np.full(len(later.columns["time_s"]), np.nan))
    session = int(vehicle.columns["link_session"][-1])
    cases = [
        (ground, ground, "is the record of a law on the ground: give that of the vehicle first"),
        (vehicle, vehicle, "is no record of `companion law`"),
        (read_flight(merged), ground, "has been merged with the ground's record already"),
        (read_flight(on_board), ground, "its law ran on board"),
        (vehicle, later, r"is of another flight of the same session: 5\d\d s lie between"),
        (vehicle, other, rf"is of another session: 1, and that of .* is {session}$"),
        (vehicle, deaf, "never heard the vehicle's clock"),
    ]
    for first, second, why in cases:
        with pytest.raises(RecordError, match=why):
            joined(first, second)


def test_the_command_leaves_no_file_where_it_refuses(sides: BothSides, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    for first, second, into in (
        (sides.vehicle, tmp_path / "none.mcap", out),
        (sides.vehicle, sides.ground, sides.ground),
        (sides.vehicle, sides.ground, tmp_path / "none" / "out.mcap"),
    ):
        said = run("records", "merge", first, second, "-o", into)
        assert isinstance(said.exception, CompanionError), said.output
        assert not out.exists()
    assert read_flight(sides.ground).is_of_ground


class _Sink:
    """Stand-in for the process that writes."""

    def __init__(self) -> None:
        self.begun: dict[str, Any] = {}
        self.ticks: list[Tick] = []

    def begin(self, metadata: dict[str, Any]) -> None:
        self.begun |= metadata

    def __call__(self, tick: Tick) -> None:
        self.ticks.append(tick)


def test_a_recorder_names_file_and_laws_and_ends_the_flight_of_a_vehicle_that_is_gone(sides: BothSides) -> None:
    sink = _Sink()
    recorder = GroundRecorder(CONFIG, sink)  # type: ignore[arg-type]
    recorder.note_law("pid")
    assert sides.flight.ground is not None
    flying = next(tick for tick in sides.flight.ground.ground.ticks if tick.flying)
    recorder(flying)
    assert sink.begun["part"] == f"ground-{flying.link.session}"
    assert sink.begun["side"] == "ground"
    assert "pid" in sink.begun["laws"]["pid"]
    recorder(replace(flying, link=replace(flying.link, silence_s=11.0)))
    assert [tick.flight.phase for tick in sink.ticks] == [Phase.TAKEOFF, Phase.STANDBY]
