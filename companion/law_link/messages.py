"""Messages of the law's link: little-endian structures, and JSON where a message is rare. Pure.

Up is from the ground to the vehicle. Times are ticks of 0.1 ms on the sender's monotonic clock, 32 bits that wrap after
119 hours. The key's tag (`sealing.py`) follows each message.
"""

import struct
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag

from companion.core.types import Vec3

TICK_S = 1e-4
"""Resolution of the stamps."""
PROTOCOL = 1
"""Version of the messages; ends of different versions do not connect."""
_WRAP = 1 << 32


class Kind(IntEnum):
    """First byte of a message."""

    HELLO = 1
    """Up: a ground law asks for a session; JSON."""
    WELCOME = 2
    """Down: the session begins; JSON."""
    REFUSED = 3
    """Down: no session, and the reason."""
    BEAT = 4
    """Up: the ground law is alive; no new command."""
    EVENT = 5
    """Up: a command, new or sent again."""
    CLOCK = 6
    """Up: a beat with the offset between the clocks."""
    ANSWER = 7
    """Up: reply to ASK; JSON."""
    REPORT = 8
    """Down: what was really sent to the autopilot, and acknowledgement."""
    PLAN = 9
    """Down: reference and arm motion of the next moments."""
    ASK = 10
    """Down: request to the ground law, such as another law; JSON."""


class UpFlags(IntFlag):
    """State of the ground law in every message up."""

    FLYING = 1
    """The law computes commands; not set on the ground."""
    BLIND = 2
    """The ground law has no fresh pose: its command is only held."""
    FAILED = 4
    """The law raised an error or gave no finite command."""
    POSE = 8
    """The message carries the pose that the law computes for."""


NO_FLAGS = UpFlags(0)


class DownFlags(IntFlag):
    """State of the vehicle in a report."""

    AIRBORNE = 1
    """The law flies the vehicle."""
    CUT = 2
    """The guard has changed the law's setpoint."""
    ARMING = 4
    """The flight is being prepared: laws are not to be exchanged now."""


class BadMessageError(ValueError):
    """Error of bytes that are no message of this protocol."""


def ticks_of(time_s: float) -> int:
    """Return a monotonic time (s) as a stamp of 32 bits."""
    return round(time_s / TICK_S) % _WRAP


def short_ticks(time_s: float) -> int:
    """Return a duration (s) in ticks, kept in 0 to 65535."""
    return min(max(round(time_s / TICK_S), 0), 65535)


def seconds_between(stamp: int, earlier: int) -> float:
    """Return the time from one stamp to another (s), in -60 to 60 hours: stamps wrap."""
    ticks = (stamp - earlier) % _WRAP
    return (ticks - _WRAP if ticks >= _WRAP // 2 else ticks) * TICK_S


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Pose that a command was computed for: position in W (m) and heading (rad)."""

    position_w_m: Vec3
    yaw_rad: float


@dataclass(frozen=True, kw_only=True)
class Command:
    """Command of the law: what the vehicle holds until the next one."""

    accel_w_mps2: Vec3
    """u = U_c/m_t - g e_3, (3,) in W."""
    yaw_rad: float
    capture_ago: int
    """Age of the frame it was computed from when it was sent, in ticks, 0 to 65535."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Offset of the clocks, and how much the ground has sent in this session."""

    offset: int
    """Vehicle's clock less the ground's, in ticks modulo 2^32."""
    sent_bytes: int
    """Payload, tags included, modulo 2^32."""
    again: int
    """Commands sent again, modulo 2^32."""
    round_trip: int
    """Quickest round trip of the last seconds, in ticks, 0 to 65535: the offset is known to half of it."""


@dataclass(frozen=True, kw_only=True)
class UpMessage:
    """Beat, clock or event: the ground law's state, and a command in an event."""

    kind: Kind
    session: int
    sequence: int
    stamp: int
    number: int
    """Number of the newest command, 16 bits; 0 before the first."""
    epoch: int
    """Flight, counted at lift-off, 8 bits, that the command belongs to."""
    law: int = 0
    """Number of the law that computes, counted at each switch, 8 bits."""
    flags: UpFlags = NO_FLAGS
    command: Command | None = None
    pose: Pose | None = None
    clock: Clock | None = None
    """In CLOCK alone."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """State of the vehicle: what it sends to the autopilot, and what it has received."""

    session: int
    sequence: int
    stamp: int
    echo: int
    """Stamp of the newest message up."""
    held: int
    """Time since its arrival, in ticks, 0 to 65535."""
    received: int
    """Messages up received so far."""
    number: int
    """Number of the command in use; 0 without one."""
    epoch: int
    law: int
    flags: DownFlags
    phase: int = 0
    """Phase of the flight: its place in `supervisor.flight_state.Phase`."""
    up_age: int
    """Median age of the messages up when a control cycle uses them, in ticks, 0 to 65535."""
    q_w_flu_wxyz: tuple[float, float, float, float]
    """Setpoint sent, after the guard: attitude, and thrust 0..1."""
    thrust: float


@dataclass(frozen=True, kw_only=True)
class Knot:
    """Reference, and motion of the arms' joints, at one instant; the ground interpolates between knots."""

    position_w_m: Vec3
    velocity_w_mps: Vec3
    acceleration_w_mps2: Vec3
    yaw_rad: float
    yaw_rate_radps: float
    joints: tuple[float, ...] = ()
    """Angles, velocities and accelerations of the joints, (24,); empty for a vehicle without arms."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Knots at equal distances in time, the first one at `begin`."""

    session: int
    sequence: int
    begin: int
    spacing: int
    """Ticks between two knots."""
    knots: tuple[Knot, ...] = field(default_factory=tuple)


@dataclass(frozen=True, kw_only=True)
class Text:
    """Message with a text: JSON of a request or reply, or a sentence."""

    kind: Kind
    session: int = 0
    sequence: int = 0
    nonce: bytes = bytes(16)
    """Of the ground, which the vehicle repeats."""
    vehicle_nonce: bytes = bytes(16)
    text: str = ""


_UP = struct.Struct("<BHIIHBBB")
_COMMAND = struct.Struct("<4fH")
_POSE = struct.Struct("<4h")
_CLOCK = struct.Struct("<IIIH")
_REPORT = struct.Struct("<BHIIIHIHBBBBH5f")
_PLAN = struct.Struct("<BHIIHBB")
_TEXT = struct.Struct("<BHI16s16s")
_POSITION_STEP_M, _YAW_STEP_RAD = 1e-3, 1e-4
_REFERENCE = 11
MESSAGE = Text | UpMessage | Report | Plan


def packed(message: MESSAGE) -> bytes:
    """Return a message as bytes, without its tag."""
    if isinstance(message, UpMessage):
        return _packed_up(message)
    if isinstance(message, Report):
        m = message
        heard = m.echo, m.held, m.received
        state = m.number, m.epoch, m.law, int(m.flags), m.phase, m.up_age
        report = (Kind.REPORT, m.session, m.sequence, m.stamp, *heard, *state, *m.q_w_flu_wxyz, m.thrust)
        return _REPORT.pack(*report)
    if isinstance(message, Plan):
        shape = len(message.knots), len(message.knots[0].joints) if message.knots else 0
        fields = Kind.PLAN, message.session, message.sequence, message.begin, message.spacing
        plan = _PLAN.pack(*fields, *shape)
        return plan + b"".join(_knot_bytes(knot) for knot in message.knots)
    head = _TEXT.pack(message.kind, message.session, message.sequence, message.nonce, message.vehicle_nonce)
    return head + message.text.encode()


def _packed_up(m: UpMessage) -> bytes:
    flags = m.flags | UpFlags.POSE if m.pose is not None else m.flags & ~UpFlags.POSE
    state = m.number, m.epoch, m.law, int(flags)
    data = _UP.pack(m.kind, m.session, m.sequence, m.stamp, *state)
    if m.command is not None:
        data += _COMMAND.pack(*m.command.accel_w_mps2, m.command.yaw_rad, m.command.capture_ago)
    if m.clock is not None:
        c = m.clock
        data += _CLOCK.pack(c.offset, c.sent_bytes % _WRAP, c.again % _WRAP, c.round_trip)
    if m.pose is not None:
        steps = [_short(one / _POSITION_STEP_M) for one in m.pose.position_w_m]
        data += _POSE.pack(*steps, _short(m.pose.yaw_rad / _YAW_STEP_RAD))
    return data


def _short(number: float) -> int:
    return min(max(round(number), -32768), 32767)


def _knot_bytes(knot: Knot) -> bytes:
    reference = *knot.position_w_m, *knot.velocity_w_mps, *knot.acceleration_w_mps2, knot.yaw_rad, knot.yaw_rate_radps
    numbers = *reference, *knot.joints
    return struct.pack(f"<{len(numbers)}f", *numbers)


def unpacked(data: bytes) -> MESSAGE:
    """Return the message in these bytes, which carry no tag any more; raises BadMessageError."""
    try:
        return _unpacked(data)
    except (struct.error, ValueError, IndexError) as error:
        raise BadMessageError(f"{len(data)} bytes are no message of the law's link: {error}") from error


def _unpacked(data: bytes) -> MESSAGE:
    kind = Kind(data[0])
    if kind in {Kind.BEAT, Kind.EVENT, Kind.CLOCK}:
        return _unpacked_up(kind, data)
    if kind is Kind.REPORT:
        return _unpacked_report(data)
    if kind is Kind.PLAN:
        return _unpacked_plan(data)
    _, session, sequence, nonce, vehicle_nonce = _TEXT.unpack_from(data)
    return Text(
        kind=kind,
        session=session,
        sequence=sequence,
        nonce=nonce,
        vehicle_nonce=vehicle_nonce,
        text=data[_TEXT.size :].decode(),
    )


def _unpacked_up(kind: Kind, data: bytes) -> UpMessage:
    _, session, sequence, stamp, number, epoch, law, bits = _UP.unpack_from(data)
    at, command, pose, clock = _UP.size, None, None, None
    if kind is Kind.EVENT:
        *accel, yaw_rad, ago = _COMMAND.unpack_from(data, at)
        command, at = Command(accel_w_mps2=_vector(accel), yaw_rad=yaw_rad, capture_ago=ago), at + _COMMAND.size
    if kind is Kind.CLOCK:
        offset, sent, again, trip = _CLOCK.unpack_from(data, at)
        clock, at = Clock(offset=offset, sent_bytes=sent, again=again, round_trip=trip), at + _CLOCK.size
    if bits & UpFlags.POSE:
        *steps, turn = _POSE.unpack_from(data, at)
        position = _vector([step * _POSITION_STEP_M for step in steps])
        pose, at = Pose(position_w_m=position, yaw_rad=turn * _YAW_STEP_RAD), at + _POSE.size
    _end_at(data, at)
    return UpMessage(
        kind=kind,
        session=session,
        sequence=sequence,
        stamp=stamp,
        number=number,
        epoch=epoch,
        law=law,
        flags=UpFlags(bits),
        command=command,
        pose=pose,
        clock=clock,
    )


def _unpacked_report(data: bytes) -> Report:
    _, session, sequence, stamp, *rest = _REPORT.unpack(data)
    echo, held, received, number, epoch, law, flags, phase, up_age, w, x, y, z, thrust = rest
    return Report(
        session=session,
        sequence=sequence,
        stamp=stamp,
        echo=echo,
        held=held,
        received=received,
        number=number,
        epoch=epoch,
        law=law,
        flags=DownFlags(flags),
        phase=phase,
        up_age=up_age,
        q_w_flu_wxyz=(w, x, y, z),
        thrust=thrust,
    )


def _unpacked_plan(data: bytes) -> Plan:
    _, session, sequence, begin, spacing, count, joints = _PLAN.unpack_from(data)
    size = 4 * (_REFERENCE + joints)
    _end_at(data, _PLAN.size + count * size)
    knots = []
    for at in range(_PLAN.size, len(data), size):
        numbers = struct.unpack_from(f"<{_REFERENCE + joints}f", data, at)
        knots.append(
            Knot(
                position_w_m=_vector(numbers[0:3]),
                velocity_w_mps=_vector(numbers[3:6]),
                acceleration_w_mps2=_vector(numbers[6:9]),
                yaw_rad=numbers[9],
                yaw_rate_radps=numbers[10],
                joints=tuple(numbers[_REFERENCE:]),
            )
        )
    return Plan(session=session, sequence=sequence, begin=begin, spacing=spacing, knots=tuple(knots))


def _vector(numbers: "list[float] | tuple[float, ...]") -> Vec3:
    x, y, z = numbers
    return x, y, z


def _end_at(data: bytes, size: int) -> None:
    if len(data) != size:
        raise BadMessageError(f"{size} bytes expected")


def is_number_newer(number: int, than: int) -> bool:
    """Return True if a 16-bit command number follows another, over the wrap."""
    return 0 < (number - than) % 65536 < 32768
