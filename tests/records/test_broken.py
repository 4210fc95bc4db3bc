"""Records that are damaged, cut, or another program's: one sentence, nothing lost that can be read, bounded memory."""

import json
import os
import struct
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Chunk, Message
from mcap.writer import CompressionType, Writer

from companion.analysis.replay.laws import config_of
from companion.analysis.report.numbers import numbers_of
from companion.analysis.report.recorded_flight import Flown
from companion.core.interfaces import CompanionError
from companion.records.flight_summary import summarize_flight
from companion.records.index import NAME, flight_summaries
from companion.records.mcap_file import MAGIC, unpacked
from companion.records.read import RecordError, read_flight
from companion.records.recorder import Recorder
from companion.supervisor.flight_state import Phase
from tests.records.flown import flight
from tests.records.test_round_trip import written

pytestmark = pytest.mark.slow

MOST_BYTES = 50_000_000
HEAD = struct.Struct("<BQ")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    (path,) = written(tmp_path_factory.mktemp("whole"), flight(track_s=1.2))
    return path.read_bytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("broken")


def chunks(data: bytes) -> list[int]:
    """Return the offset of each chunk record, bytes."""
    found, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = HEAD.unpack_from(data, at)
        if opcode == Opcode.CHUNK:
            found.append(at)
        at += HEAD.size + length
    return found


def with_number(data: bytes, at: int, value: int) -> bytes:
    return data[:at] + struct.pack("<Q", value) + data[at + 8 :]


def foreign(path: Path, compression: CompressionType = CompressionType.ZSTD, topic: str = "/qualisys/pose") -> Path:
    """A bag as ROS 2 records it."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start("ros2", "rosbag2")
        schema = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", b"std_msgs/Header header\n")
        channel = writer.register_channel(topic, "cdr", schema)
        for number in range(50):
            writer.add_message(channel, number * 10**7, b"\0\1\0\0" + bytes(60), number * 10**7)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def use_all(path: Path) -> None:
    """All that commands make of a record; CompanionError where they refuse it in a sentence."""
    summarize_flight(path)
    record = read_flight(path)
    json.dumps(numbers_of(Flown(record)).as_dict(), allow_nan=False)
    config_of(record)
    assert record.first_estimate is None or record.first_estimate.run >= 0
    for _ in record.ticks():
        pass


def use_or_refuse(path: Path) -> int:
    """Bytes that it took; any exception but a sentence is the test's failure."""
    said = ""
    tracemalloc.start()
    try:
        use_all(path)
    except CompanionError as error:
        said = str(error)
    finally:
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert not said or (str(path) in said and "\n" not in said)
    return most


LENGTHS = (2**64 - 1, 2**62, 10**12, 40 << 30, 0, 1)


@pytest.mark.parametrize("length", LENGTHS)
def test_a_record_in_it_with_a_wrong_length_costs_that_part_alone(whole: bytes, folder: Path, length: int) -> None:
    path = folder / "length.mcap"
    at = chunks(whole)[1]
    path.write_bytes(with_number(whole, at + 1, length))
    assert use_or_refuse(path) < MOST_BYTES
    record = read_flight(path)
    path.write_bytes(whole)
    missing = len(read_flight(path).columns["tick"]) - len(record.columns["tick"])
    assert missing == record.dropped <= 50, "half a second of a chunk"
    assert bool(record.damage) == (length > 1), "a chunk tells its own length once more"
    assert not record.truncated


@pytest.mark.parametrize("length", LENGTHS[:4])
def test_a_wrong_length_in_a_file_that_is_cut_off_keeps_what_was_before(
    whole: bytes, folder: Path, length: int
) -> None:
    path = folder / "cut.mcap"
    at = chunks(whole)[-1]
    path.write_bytes(with_number(whole, at + 1, length)[: at + 5000])
    assert use_or_refuse(path) < MOST_BYTES
    record = read_flight(path)
    assert record.truncated
    assert len(record.columns["tick"]) > 50
    assert summarize_flight(path).truncated


@pytest.mark.parametrize("size", [2**60, 200 << 30, 255_000_000, 5])
def test_a_chunk_is_never_unpacked_to_more_than_is_in_it(whole: bytes, folder: Path, size: int) -> None:
    path = folder / "size.mcap"
    at = chunks(whole)[1] + HEAD.size + 16
    path.write_bytes(with_number(whole, at, size))
    assert use_or_refuse(path) < MOST_BYTES
    record = read_flight(path)
    assert "a chunk" in record.damage
    assert not record.truncated
    assert 0 < record.dropped <= 50


def test_a_flipped_bit_in_a_chunk_is_noticed_and_the_others_are_read(whole: bytes, folder: Path) -> None:
    path = folder / "bit.mcap"
    at = chunks(whole)[1] + 2000
    path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    record = read_flight(path)
    assert record.damage.startswith(("a chunk whose checksum", "an unreadable part"))
    assert 0 < record.dropped <= 50
    assert np.isfinite(record.columns["time_s"]).all()


def test_damage_where_the_flight_begins_is_told_with_what_can_be_done(whole: bytes, folder: Path) -> None:
    path = folder / "begin.mcap"
    path.write_bytes(with_number(whole, len(MAGIC) + 1, 2**64 - 1)[:20000])
    with pytest.raises(RecordError, match=r"begin\.mcap: a damaged MCAP file .* `mcap recover`"):
        read_flight(path)


@settings(max_examples=30)
@given(data=st.data())
def test_whatever_bytes_are_overwritten_there_is_a_record_or_a_sentence(
    whole: bytes, folder: Path, data: st.DataObject
) -> None:
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(broken) - 1))
        new = data.draw(st.binary(min_size=1, max_size=9))
        broken[at : at + len(new)] = new
    path = folder / "any.mcap"
    path.write_bytes(bytes(broken[: data.draw(st.sampled_from([len(broken), len(broken) * 2 // 3]))]))
    assert use_or_refuse(path) < MOST_BYTES


@settings(max_examples=30)
@given(data=st.data())
def test_an_npz_file_with_any_bytes_overwritten_is_a_record_or_a_sentence(folder: Path, data: st.DataObject) -> None:
    path = folder / "any.npz"
    good = folder / "good.npz"
    if not good.exists():
        recorder = Recorder()
        for tick in flight(track_s=0.1):
            recorder(tick)
        recorder.write(good)
    broken = bytearray(good.read_bytes())
    at = data.draw(st.integers(0, len(broken) - 1))
    new = data.draw(st.binary(min_size=1, max_size=9))
    broken[at : at + len(new)] = new
    path.write_bytes(bytes(broken))
    assert use_or_refuse(path) < MOST_BYTES


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_another_programs_file_is_called_that(folder: Path, compression: CompressionType) -> None:
    with pytest.raises(RecordError, match=r"of another program, 'rosbag2', .*its topics are /qualisys/pose"):
        read_flight(foreign(folder / "ros2_bag_0.mcap", compression))


def test_another_programs_topic_of_the_same_name_is_no_flight(folder: Path) -> None:
    with pytest.raises(RecordError, match="without a single tick of a flight"):
        read_flight(foreign(folder / "flight.mcap", topic="/flight"))
    use_or_refuse(foreign(folder / "event.mcap", topic="/event"))


def odd_files(folder: Path, whole: bytes) -> Iterator[tuple[str, str]]:
    """Names of files that are no records, made here, and what is to be said of each."""
    for name, content, says in (
        ("empty.mcap", b"", "an empty file"),
        ("head.mcap", MAGIC, "without a single tick"),
        ("text.mcap", b"hello", "neither an MCAP file"),
        ("text.npz", b"PK\x03\x04", "a damaged NPZ file"),
    ):
        (folder / name).write_bytes(content)
        yield name, says
    yield foreign(folder / "bag.mcap").name, "another program"
    (folder / "folder.mcap").mkdir()
    yield "folder.mcap", "is a folder"
    os.mkfifo(folder / "pipe.mcap")
    yield "pipe.mcap", "is a pipe"
    (folder / "gone.mcap").symlink_to(folder / "nowhere")
    yield "gone.mcap", "cannot be read: No such file"
    if os.geteuid() != 0:
        (folder / "secret.mcap").write_bytes(whole)
        (folder / "secret.mcap").chmod(0)
        yield "secret.mcap", "cannot be read: Permission denied"


def test_a_list_has_every_file_and_says_of_each_what_it_is_instead_of_a_record(whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "20260101-120000-one.mcap").write_bytes(whole)
    says = dict(odd_files(tmp_path, whole))
    for _ in range(2):  # the second time out of the index
        found = {line.path.name: line for line in flight_summaries(tmp_path)}
        assert found.keys() == {"20260101-120000-one.mcap", *says}
        assert found["20260101-120000-one.mcap"].law == "practical"
        for name, said in says.items():
            assert said in found[name].unreadable, name
    with pytest.raises(RecordError, match="is a pipe"):
        read_flight(tmp_path / "pipe.mcap")


def test_a_file_that_vanishes_while_it_is_listed_is_left_out(whole: bytes, tmp_path: Path) -> None:
    for name in ("20260101-120000-one.mcap", "20260102-120000-one.mcap"):
        (tmp_path / name).write_bytes(whole)

    def remove(done: int, of: int) -> None:
        if done == 0:
            for path in tmp_path.glob("20260102*"):
                path.unlink()
            (tmp_path / "20260101-120000-one.mcap").rename(tmp_path / "elsewhere")

    assert flight_summaries(tmp_path, remove) == []


def test_a_list_looks_only_into_what_is_new_or_has_changed(whole: bytes, tmp_path: Path) -> None:
    paths = [tmp_path / f"2026010{day}-120000-one.mcap" for day in (1, 2, 3)]
    for path in paths:
        path.write_bytes(whole)
    looked: list[int] = []

    def count(done: int, of: int) -> None:
        looked.append(of)

    first = flight_summaries(tmp_path, count)
    assert looked == [3, 3, 3]
    assert [line.path for line in first] == paths
    looked.clear()
    assert flight_summaries(tmp_path, count) == first
    assert not looked
    paths[1].write_bytes(whole[: len(whole) * 2 // 3])
    paths[2].unlink()
    changed = flight_summaries(tmp_path, count)
    assert looked == [1]
    assert [(line.path, line.truncated) for line in changed] == [(paths[0], False), (paths[1], True)]


@pytest.mark.parametrize("index", [b"", b"\xff\xfe", b"[" * 5000, b'{"version": 1, "records": 5}', b"null"])
def test_a_broken_index_is_made_anew(whole: bytes, tmp_path: Path, index: bytes) -> None:
    path = tmp_path / "20260101-120000-one.mcap"
    path.write_bytes(whole)
    (line,) = flight_summaries(tmp_path)
    there = json.loads((tmp_path / NAME).read_bytes())
    (tmp_path / NAME).write_bytes(index)
    assert flight_summaries(tmp_path) == [line]
    assert json.loads((tmp_path / NAME).read_bytes()) == there
    for odd in ({"length_s": "long"}, {"law": None}, {"stamp": 7}):
        lines = {path.name: there["records"][path.name] | odd}
        (tmp_path / NAME).write_text(json.dumps(there | {"records": lines}), encoding="utf-8")
        assert flight_summaries(tmp_path) == [line]


def test_a_folder_that_cannot_be_written_to_is_listed_all_the_same(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "20260101-120000-one.mcap").write_bytes(whole)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.NamedTemporaryFile", refuse)
    assert len(flight_summaries(tmp_path)) == 1
    assert not (tmp_path / NAME).exists()


def test_all_laws_of_a_flight_are_listed_and_not_only_the_last(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight(controllers=("practical", "pid")))
    assert summarize_flight(path).law == "practical, pid"
    path.write_bytes(path.read_bytes()[:-500])
    assert summarize_flight(path).law == "practical, pid"


def test_a_flight_in_which_no_law_ran_has_no_law(tmp_path: Path) -> None:
    ticks = [replace(tick, law="etnn") for tick in flight() if tick.flight.phase is not Phase.TRACK]
    (path,) = written(tmp_path, ticks)
    assert summarize_flight(path).law == ""
    assert read_flight(path).laws == ()
    assert not read_flight(path).law_flew


def test_a_message_that_is_shorter_than_its_head_makes_a_damaged_chunk() -> None:
    whole = struct.pack("<BQHIQQ", Opcode.MESSAGE, 24, 7, 1, 2, 3) + b"{}"
    (message,) = unpacked(Chunk("", whole, 0, 0, 0, len(whole)))
    assert message == Message(channel_id=7, log_time=2, data=b"{}", publish_time=3, sequence=1)
    cut = struct.pack("<BQHI", Opcode.MESSAGE, 6, 7, 1) + whole
    with pytest.raises(EndOfFile):
        unpacked(Chunk("", cut, 0, 0, 0, len(cut)))
