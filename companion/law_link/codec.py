"""Bytes of the law's link: each message as a little-endian structure, without its tag. Pure."""

import struct

from companion.core.types import Vec3
from companion.law_link.messages import (
    MESSAGE,
    WRAP,
    BadMessageError,
    Clock,
    Command,
    DownFlags,
    Kind,
    Knot,
    Plan,
    Pose,
    Report,
    Text,
    UpFlags,
    UpMessage,
)

_UP = struct.Struct("<BHIIHB")
_COMMAND = struct.Struct("<4fH")
_POSE = struct.Struct("<4h")
_CLOCK = struct.Struct("<IIIH")
_REPORT = struct.Struct("<BHIIIHIHBBBBH5f")
_PLAN = struct.Struct("<BHIIHBB")
_TEXT = struct.Struct("<BHI16s16s")
_POSITION_STEP_M, _YAW_STEP_RAD = 1e-3, 1e-4
_REFERENCE = 11
_HALF = 16


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
    halves = _halves(m.kind, int(flags)), _halves(m.epoch, m.law)
    data = _UP.pack(halves[0], m.session, m.sequence, m.stamp, m.number, halves[1])
    if m.command is not None:
        data += _COMMAND.pack(*m.command.accel_w_mps2, m.command.yaw_rad, m.command.capture_ago)
    if m.clock is not None:
        c = m.clock
        data += _CLOCK.pack(c.offset, c.sent_bytes % WRAP, c.again % WRAP, c.round_trip)
    if m.pose is not None:
        steps = [_short(one / _POSITION_STEP_M) for one in m.pose.position_w_m]
        data += _POSE.pack(*steps, _short(m.pose.yaw_rad / _YAW_STEP_RAD))
    return data


def _short(number: float) -> int:
    return min(max(round(number), -32768), 32767)


def _halves(low: int, high: int) -> int:
    """Return two numbers of 0 to 15 in one byte: a beat goes up 33 times a second."""
    if not (0 <= low < _HALF and 0 <= high < _HALF):
        raise ValueError(f"{low} and {high}: must be 0 to {_HALF - 1}")
    return low + _HALF * high


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
    up = data[0] % _HALF
    if up in {Kind.BEAT, Kind.EVENT, Kind.CLOCK}:
        return _unpacked_up(Kind(up), data)
    kind = Kind(data[0])
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
    first, session, sequence, stamp, number, last = _UP.unpack_from(data)
    bits, (law, epoch) = first // _HALF, divmod(last, _HALF)
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
