"""The mock's answers to commands, and the frames that a stream request selects."""

import pytest

from mock_autopilot.qtm import packets as qtm
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.session import NO_MORE_DATA, RefusedError, Session, StreamRequest, parse_stream

CONFIG = QualisysConfig(body="dauam", extra_bodies=("leader",))


def answer(command: str, capturing: bool = True) -> tuple[int, bytes]:
    """Type and payload of the only packet that comes back."""
    (packet,) = Session(CONFIG).answer(command, None, capturing)
    return qtm.HEADER.unpack_from(packet)[1], packet[8:]


@pytest.mark.parametrize("command", ["version 1.25", "Version 1.25", "VERSION 1.25"])
def test_the_version_is_set_in_any_case(command: str) -> None:
    assert answer(command) == (qtm.PacketType.COMMAND, b"Version set to 1.25\0")


@pytest.mark.parametrize("version", ["1.26", "1.7", "2.0", "1", "x", "1.2.5"])
def test_an_unknown_version_is_refused(version: str) -> None:
    assert answer(f"version {version}") == (qtm.PacketType.ERROR, b"Version NOT supported\0")


def test_the_settings_name_the_bodies_in_the_order_of_the_data() -> None:
    session = Session(CONFIG)
    session.answer("version 1.25", None, True)
    (packet,) = session.answer("GetParameters 6D", None, True)
    text = packet[8:-1].decode()
    assert text.startswith("<QTM_Parameters_Ver_1.25><The_6D><Body><Name>dauam</Name>")
    assert text.index("dauam") < text.index("leader")


def test_all_settings_hold_the_rate_too() -> None:
    assert b"<Frequency>100</Frequency>" in answer("getparameters all")[1]


@pytest.mark.parametrize(
    "command", ["", "dance", "getparameters", "getparameters analog", "streamframes", "streamframes sometimes 6d"]
)
def test_what_is_not_understood_is_a_parse_error(command: str) -> None:
    assert answer(command) == (qtm.PacketType.ERROR, b"Parse error\0")


def test_a_kind_of_data_it_has_not_is_named_in_the_error() -> None:
    assert answer("streamframes allframes 3d") == (qtm.PacketType.ERROR, b"Component not supported: 3d\0")


def test_the_state_tells_whether_it_measures() -> None:
    assert answer("getstate") == (qtm.PacketType.EVENT, bytes([qtm.Event.CONNECTED]))
    assert answer("getstate", capturing=False) == (qtm.PacketType.EVENT, bytes([qtm.Event.CAPTURE_STOPPED]))


def test_without_a_measurement_there_is_no_more_data() -> None:
    assert Session(CONFIG).answer("streamframes allframes 6d", None, False) == [NO_MORE_DATA]
    assert Session(CONFIG).answer("getcurrentframe 6d", None, True) == [NO_MORE_DATA]


def test_the_stream_starts_and_stops_without_a_word() -> None:
    session = Session(CONFIG)
    assert session.answer("streamframes allframes 6d", None, True) == []
    assert session.stream is not None
    assert session.answer("streamframes stop", None, True) == []
    assert session.stream is None


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("allframes 6dres", StreamRequest((qtm.Component.SIX_D_RES,))),
        ("frequency:50 6d", StreamRequest((qtm.Component.SIX_D,), frequency_hz=50.0)),
        ("frequencydivisor:4 6d", StreamRequest((qtm.Component.SIX_D,), divisor=4)),
        ("allframes udp:7000 6d", StreamRequest((qtm.Component.SIX_D,), udp_port=7000)),
        ("allframes udp:10.0.0.2:7000 6d", StreamRequest((qtm.Component.SIX_D,), udp_port=7000, udp_host="10.0.0.2")),
    ],
)
def test_stream_requests_are_understood(words: str, expected: StreamRequest) -> None:
    assert parse_stream(words.split()) == expected


@pytest.mark.parametrize(
    "words", ["allframes", "frequency:0 6d", "frequency:x 6d", "allframes udp:0 6d", "allframes udp:nowhere:70 6d"]
)
def test_wrong_stream_requests_are_refused(words: str) -> None:
    with pytest.raises(RefusedError):
        parse_stream(words.split())


@pytest.mark.parametrize(("frequency_hz", "expected"), [(100, 100), (50, 50), (30, 30), (1000, 100)])
def test_a_frequency_picks_so_many_frames_of_a_second(frequency_hz: float, expected: int) -> None:
    request = StreamRequest((qtm.Component.SIX_D,), frequency_hz=frequency_hz)
    assert sum(request.wants(n, 100.0) for n in range(100)) == expected


def test_a_divisor_picks_every_nth_frame() -> None:
    request = StreamRequest((qtm.Component.SIX_D,), divisor=4)
    assert [n for n in range(12) if request.wants(n, 100.0)] == [0, 4, 8]
