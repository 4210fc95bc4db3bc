"""The mock's bytes against packets written out by hand."""

import numpy as np
import pytest

from mock_autopilot.qtm import packets as qtm
from mock_autopilot.qtm.packets import BodyPose, Component, Frame, PacketType

ROTATION = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter turn to the left: row 1 is (0, -1, 0), so column by column it reads 0 1 0, -1 0 0, 0 0 1."""
POSE = BodyPose(np.array([1.0, -2.0, 0.5]), ROTATION, 0.00075)


def test_a_command_is_size_type_text_and_nul() -> None:
    assert qtm.text_packet(PacketType.COMMAND, "ok") == bytes.fromhex("0b000000 01000000 6f6b00")


def test_an_event_is_one_byte() -> None:
    assert qtm.event_packet(qtm.Event.CAPTURE_STOPPED) == bytes.fromhex("09000000 06000000 04")


def test_a_data_packet_with_residual_matches_the_hand_written_one() -> None:
    expected = bytes.fromhex(
        "5c000000 03000000"  # 8 + 16 + 68 = 92 bytes, data
        "40420f0000000000 07000000 01000000"  # 1,000,000 us, frame 7, one component
        "44000000 0b000000"  # 8 + 8 + 13 * 4 = 68 bytes, 6D with residual
        "01000000 0000 0000"  # one body, no drops
        "00007a44 0000fac4 0000fa43"  # 1000, -2000, 500 mm
        "00000000 0000803f 00000000"  # column 1
        "000080bf 00000000 00000000"  # column 2
        "00000000 00000000 0000803f"  # column 3
        "0000403f"  # 0.75 mm
    )
    assert qtm.data_packet(Frame(7, 1_000_000, (POSE,)), [Component.SIX_D_RES]) == expected


def test_components_stand_in_the_order_they_were_asked_for() -> None:
    data = qtm.data_packet(Frame(1, 0, (POSE,)), [Component.SIX_D_EULER, Component.SIX_D])
    assert data[20:24] == b"\x02\0\0\0"
    assert data[28:32] == b"\x06\0\0\0"  # after the size of the first component, 8 + 8 + 24 = 40 bytes
    assert data[24 + 40 + 4 : 24 + 40 + 8] == b"\x05\0\0\0"


def test_a_lost_body_is_nan_in_every_number() -> None:
    lost = BodyPose(np.full(3, np.nan), np.full((3, 3), np.nan), float("nan"))
    data = qtm.data_packet(Frame(1, 0, (lost,)), [Component.SIX_D_RES])
    assert np.isnan(np.frombuffer(data[40:], "<f4")).all()
    assert len(data[40:]) == 13 * 4


@pytest.mark.parametrize(
    ("rotation", "expected_deg", "because"),
    [
        (np.eye(3), (0, 0, 0), "no turn"),
        (np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), (90, 0, 0), "y goes to z: a quarter turn about x is roll"),
        (np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]), (0, 36.87, 0), "z leans to x: about y is pitch"),
        (ROTATION, (0, 0, 90), "x goes to y: a quarter turn about z is yaw"),
    ],
)
def test_euler_angles_follow_the_qualisys_standard(
    rotation: np.ndarray, expected_deg: tuple[float, ...], because: str
) -> None:
    assert qtm.euler_deg(rotation.astype(float)) == pytest.approx(expected_deg, abs=0.01), because


def test_names_are_escaped_in_the_settings() -> None:
    assert "<Name>a&lt;b &amp; c</Name>" in qtm.parameters_xml(["6d"], [qtm.Body("a<b & c")], 100.0)


def test_commands_are_taken_whole_and_the_rest_is_kept() -> None:
    two = qtm.text_packet(PacketType.COMMAND, "version 1.25") + qtm.text_packet(PacketType.COMMAND, "getstate")
    buffer = bytearray(two[:-3])
    assert qtm.take_commands(buffer) == ["version 1.25"]
    buffer += two[-3:]
    assert qtm.take_commands(buffer) == ["getstate"]
    assert buffer == b""


@pytest.mark.parametrize(
    "garbage",
    [b"\0" * 8, b"GET / HTTP/1.1\r\n\r\n", qtm.packet(PacketType.COMMAND, b"\xff\xfe\0"), qtm.HEADER.pack(7, 1)],
)
def test_bytes_that_are_no_command_are_refused(garbage: bytes) -> None:
    with pytest.raises(qtm.GarbageError):
        qtm.take_commands(bytearray(garbage))
