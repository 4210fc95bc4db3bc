"""Bytes and text of the QTM RT protocol 1.25, little endian; pure, no sockets.

Source: "QTM Real-time Server Protocol Documentation" (Qualisys). Lengths on the wire are millimetres.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from xml.sax.saxutils import escape

import numpy as np

from mock_autopilot.physics.quaternion import Array

HEADER = struct.Struct("<II")
MAX_COMMAND_BYTES = 65536
"""A client's command longer than this is garbage."""


class PacketType(IntEnum):
    """Types of a packet's contents."""

    ERROR = 0
    COMMAND = 1
    XML = 2
    DATA = 3
    NO_MORE_DATA = 4
    EVENT = 6


class Event(IntEnum):
    """Events of the capture; also the answer to `getstate`."""

    CONNECTED = 1
    CONNECTION_CLOSED = 2
    CAPTURE_STARTED = 3
    CAPTURE_STOPPED = 4
    SETTINGS_CHANGED = 11
    SHUTTING_DOWN = 12


class Component(IntEnum):
    """The kinds of data this server has."""

    SIX_D = 5
    SIX_D_EULER = 6
    SIX_D_RES = 11
    SIX_D_EULER_RES = 12


COMPONENTS = {
    "6d": Component.SIX_D,
    "6deuler": Component.SIX_D_EULER,
    "6dres": Component.SIX_D_RES,
    "6deulerres": Component.SIX_D_EULER_RES,
}
"""Their names in commands, lower case."""


class GarbageError(ValueError):
    """The bytes cannot be a packet of the protocol."""


@dataclass(frozen=True)
class BodyPose:
    """One rigid body in one frame: room z up, body FLU; NaN all through when it is lost."""

    position_room_m: Array
    """Shape (3,)."""
    rotation_room_flu: Array
    """Shape (3, 3), body into room."""
    residual_m: float


@dataclass(frozen=True)
class Body:
    """One rigid body of QTM's settings."""

    name: str
    enabled: bool = True


@dataclass(frozen=True)
class Frame:
    """All bodies at one capture."""

    number: int
    stamp_us: int
    bodies: tuple[BodyPose, ...]


def packet(kind: PacketType, payload: bytes) -> bytes:
    """Put the header before a payload; the size includes the header."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def text_packet(kind: PacketType, text: str) -> bytes:
    """Pack a command, an error or an XML document, ended by a NUL."""
    return packet(kind, text.encode() + b"\0")


def event_packet(event: Event) -> bytes:
    """Pack an event: a single byte."""
    return packet(PacketType.EVENT, bytes([event]))


def data_packet(frame: Frame, components: Sequence[Component]) -> bytes:
    """Pack one frame with the components in the order they were asked for."""
    head = struct.pack("<qII", frame.stamp_us, frame.number, len(components))
    return packet(PacketType.DATA, head + b"".join(_component(frame.bodies, kind) for kind in components))


def _component(bodies: Sequence[BodyPose], kind: Component) -> bytes:
    body = struct.pack("<ihh", len(bodies), 0, 0) + b"".join(_body(pose, kind) for pose in bodies)
    return struct.pack("<II", 8 + len(body), kind) + body


def _body(pose: BodyPose, kind: Component) -> bytes:
    values = [1e3 * float(x) for x in pose.position_room_m]
    if kind in (Component.SIX_D, Component.SIX_D_RES):
        values += [float(x) for x in pose.rotation_room_flu.T.ravel()]  # column by column
    else:
        values += euler_deg(pose.rotation_room_flu)
    if kind in (Component.SIX_D_RES, Component.SIX_D_EULER_RES):
        values.append(1e3 * pose.residual_m)
    return struct.pack(f"<{len(values)}f", *values)


def euler_deg(rotation: Array) -> list[float]:
    """Roll, pitch, yaw (degrees) by the Qualisys standard: R = Rx(roll) Ry(pitch) Rz(yaw), turning local axes."""
    roll = np.arctan2(-rotation[1, 2], rotation[2, 2])
    pitch = np.arcsin(np.clip(rotation[0, 2], -1.0, 1.0))
    yaw = np.arctan2(-rotation[0, 1], rotation[0, 0])
    return [float(angle) for angle in np.degrees([roll, pitch, yaw])]


def parameters_xml(sections: Sequence[str], bodies: Sequence[Body], rate_hz: float, version: str = "1.25") -> str:
    """Settings as `getparameters` gives them; the bodies stand in the order of the data.

    1.21 brought the origin of a body's coordinate system, 1.24 whether it is enabled (qualisys_cpp_sdk,
    SettingsDeserializer.cpp).
    """
    parts = []
    if "general" in sections:
        parts.append(f"<General><Frequency>{rate_hz:g}</Frequency></General>")
    if "6d" in sections:
        minor = int(version.partition(".")[2])
        parts.append(f"<The_6D>{''.join(_body_xml(body, minor) for body in bodies)}</The_6D>")
    root = f"QTM_Parameters_Ver_{version}"
    return f"<{root}>{''.join(parts)}</{root}>"


def _body_xml(body: Body, minor: int) -> str:
    enabled = f"<Enabled>{str(body.enabled).lower()}</Enabled>" if minor >= 24 else ""
    origin = '<Data_origin X="0" Y="0" Z="0" Relative_body="1">0</Data_origin>' if minor >= 21 else ""
    return f"<Body><Name>{escape(body.name)}</Name>{enabled}{origin}</Body>"


def take_commands(buffer: bytearray) -> list[str]:
    """Remove the complete commands from the front of `buffer` and return them; GarbageError when it holds no such."""
    commands = []
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if kind not in (PacketType.COMMAND, PacketType.XML) or not HEADER.size <= size <= MAX_COMMAND_BYTES:
            raise GarbageError(f"a packet of type {kind} and size {size} is not a command")
        if len(buffer) < size:
            break
        commands.append(_text(bytes(buffer[HEADER.size : size])))
        del buffer[:size]
    return commands


def _text(payload: bytes) -> str:
    try:
        return payload.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError as error:
        raise GarbageError("the command is not text") from error
