"""Bytes of both protocols: the manuals' examples, and anything that may come down a noisy line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_autopilot.servos.packets import Block, Packet, Parser, checksum, crc16, fast_status, pack1, pack2, status2
from tests.mock_autopilot.servos.dynamixel_examples import FAST_SYNC_READ_ANSWER, PROTOCOL_1, PROTOCOL_2, Example

EXAMPLES = [pytest.param(example, id=f"{example.protocol}.0 {example.name}") for example in PROTOCOL_1 + PROTOCOL_2]

ids = st.one_of(st.integers(0, 0xFC), st.just(0xFE))
risky = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55, 0x01]), max_size=40).map(bytes)
params = st.one_of(st.binary(max_size=60), risky)


@st.composite
def packets(draw: st.DrawFn) -> Packet:
    return Packet(draw(st.sampled_from([1, 2])), draw(ids), draw(st.integers(0, 255)), draw(params))


def packed(packet: Packet) -> bytes:
    pack = pack1 if packet.protocol == 1 else pack2
    return pack(packet.id, packet.code, packet.params)


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_instruction_of_the_manual_is_understood(example: Example) -> None:
    wanted = Packet(example.protocol, example.id, example.instruction, example.param_bytes)
    assert Parser().feed(example.request_bytes) == [wanted]
    assert packed(wanted) == example.request_bytes


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_answer_of_the_manual_comes_out_of_the_packer_as_printed(example: Example) -> None:
    for raw in example.answer_bytes:
        [packet] = Parser().feed(raw)
        assert packet.intact
        assert packed(packet) == raw


def test_the_manual_s_answer_with_two_errors_is_packed_as_printed() -> None:
    assert pack1(1, 0x24) == bytes.fromhex("FF FF 01 02 24 D8")


def test_the_manual_s_common_answer_to_a_fast_sync_read_is_packed_as_printed() -> None:
    blocks = [Block(i, 0, at.to_bytes(4, "little")) for i, at in ((3, 166), (7, 2079), (4, 1023))]
    assert fast_status(blocks) == FAST_SYNC_READ_ANSWER


def test_a_broken_chain_ends_after_the_last_servo_that_sent_but_announces_them_all() -> None:
    blocks = [Block(i, 0, bytes(4)) for i in (3, 7, 4)]
    assert fast_status(blocks, present=2) == fast_status(blocks)[: -4 - 4]
    assert fast_status(blocks, present=0) == b""


def test_checksum_is_that_of_the_manual_s_worked_example() -> None:
    assert checksum(bytes([0x01, 0x05, 0x03, 0x0C, 0x64, 0xAA])) == 0xDC


def test_crc_is_zero_over_a_whole_packet_with_its_crc_turned_round() -> None:
    raw = PROTOCOL_2[0].request_bytes
    assert crc16(raw[:-2] + raw[:-3:-1]) == 0


def test_a_header_inside_the_parameters_is_stuffed() -> None:
    raw = pack2(1, 0x03, bytes.fromhex("74 00 FF FF FD 00"))
    assert raw[5:-2] == bytes.fromhex("0A 00 03 74 00 FF FF FD FD 00")


def test_the_error_byte_can_be_part_of_a_header_that_needs_stuffing() -> None:
    [packet] = Parser().feed(status2(1, 0xFF, bytes([0xFF, 0xFD])))
    assert packet.params == bytes([0xFF, 0xFF, 0xFD])


@given(packets())
def test_every_packet_comes_back_as_it_went(packet: Packet) -> None:
    assert Parser().feed(packed(packet)) == [packet]


@given(st.lists(packets(), max_size=6), st.randoms(use_true_random=False))
def test_packets_of_both_protocols_come_out_of_one_stream_however_it_is_cut(sent: list[Packet], rng: object) -> None:
    stream = b"".join(packed(packet) for packet in sent)
    parser, got = Parser(), []
    at = 0
    while at < len(stream):
        step = rng.randint(1, 9)  # type: ignore[attr-defined]
        got += parser.feed(stream[at : at + step])
        at += step
    assert got == sent


@given(st.binary(max_size=30).filter(lambda noise: 0xFF not in noise), packets())
def test_noise_before_a_header_is_passed_over(noise: bytes, packet: Packet) -> None:
    assert Parser().feed(noise + packed(packet)) == [packet]


@given(packets(), st.data())
def test_a_damaged_body_is_noticed(packet: Packet, data: st.DataObject) -> None:
    raw = bytearray(packed(packet))
    head = 4 if packet.protocol == 1 else 7
    place = data.draw(st.integers(head, len(raw) - 1))
    raw[place] ^= data.draw(st.integers(1, 255))
    [got] = Parser().feed(bytes(raw))
    assert not got.intact


@given(st.binary(max_size=300))
def test_no_garbage_stops_the_parser(garbage: bytes) -> None:
    parser = Parser()
    parser.feed(garbage)
    parser.reset()
    ping = PROTOCOL_2[0]
    assert parser.feed(ping.request_bytes) == [Packet(2, 1, 1, b"")]


def test_a_third_ff_belongs_to_no_header() -> None:
    assert Parser().feed(b"\xff" + PROTOCOL_1[0].request_bytes) == [Packet(1, 1, 1, b"")]


@pytest.mark.parametrize(
    "nonsense", ["FF FF 01 00", "FF FF FD 01 01 03 00", "FF FF FD 00 01 00 00", "FF FF FD 00 01 FF FF"]
)
def test_an_impossible_length_or_reserved_byte_is_no_packet(nonsense: str) -> None:
    packet = Packet(2, 5, 1, b"")
    assert Parser().feed(bytes.fromhex(nonsense) + packed(packet)) == [packet]
