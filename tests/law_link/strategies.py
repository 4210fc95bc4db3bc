"""Messages of the law's link as hypothesis draws them, with the ranges that fit into their fields."""

import struct
from random import Random

from hypothesis import strategies as st

from companion.law_link.messages import (
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

U4, U8, U16, U32 = (st.integers(0, 2**bits - 1) for bits in (4, 8, 16, 32))
F32 = st.floats(-1e3, 1e3, width=32)
THREE = st.tuples(F32, F32, F32)

COMMANDS = st.builds(Command, accel_w_mps2=THREE, yaw_rad=F32, capture_ago=U16)
CLOCKS = st.builds(Clock, offset=U32, sent_bytes=U32, again=U32, round_trip=U16)
MILLIMETRES = st.integers(-32767, 32767)
POSES = st.builds(
    lambda x, y, z, turn: Pose(position_w_m=(x * 1e-3, y * 1e-3, z * 1e-3), yaw_rad=turn * 1e-4),
    *[MILLIMETRES] * 4,
)
"""Poses that the message's steps of 1 mm and 0.1 mrad can say exactly."""


@st.composite
def ups(draw: st.DrawFn) -> UpMessage:
    """Beats, events and clocks, with and without a pose."""
    kind = draw(st.sampled_from([Kind.BEAT, Kind.EVENT, Kind.CLOCK]))
    pose = draw(st.none() | POSES)
    flags = draw(st.sampled_from([UpFlags(bits) for bits in range(8)]))
    return UpMessage(
        kind=kind,
        session=draw(U16),
        sequence=draw(U32),
        stamp=draw(U32),
        number=draw(U16),
        epoch=draw(U4),
        law=draw(U4),
        flags=flags | UpFlags.POSE if pose is not None else flags,
        command=draw(COMMANDS) if kind is Kind.EVENT else None,
        pose=pose,
        clock=draw(CLOCKS) if kind is Kind.CLOCK else None,
    )


REPORTS = st.builds(
    Report,
    session=U16,
    sequence=U32,
    stamp=U32,
    echo=U32,
    held=U16,
    received=U32,
    number=U16,
    epoch=U8,
    law=U8,
    flags=st.sampled_from([DownFlags(bits) for bits in range(8)]),
    phase=st.integers(0, 20),
    up_age=U16,
    q_w_flu_wxyz=st.tuples(F32, F32, F32, F32),
    thrust=F32,
)


def _plan(seed: int, count: int, with_arms: bool) -> Plan:
    """Return a plan of random numbers, which are drawn faster than by hypothesis."""
    random = Random(seed)

    def numbers(count: int) -> tuple[float, ...]:
        return struct.unpack(f"<{count}f", struct.pack(f"<{count}f", *(random.gauss(0.0, 10.0) for _ in range(count))))

    def three() -> tuple[float, float, float]:
        x, y, z = numbers(3)
        return x, y, z

    knots = tuple(
        Knot(
            position_w_m=three(),
            velocity_w_mps=three(),
            acceleration_w_mps2=three(),
            yaw_rad=numbers(1)[0],
            yaw_rate_radps=numbers(1)[0],
            joints=numbers(24 if with_arms else 0),
        )
        for _ in range(count)
    )
    return Plan(session=seed % 65536, sequence=seed, begin=seed, spacing=2000, knots=knots)


PLANS = st.builds(_plan, U32, st.integers(0, 4), st.booleans())

TEXTS = st.builds(
    Text,
    kind=st.sampled_from([Kind.HELLO, Kind.WELCOME, Kind.REFUSED, Kind.ASK, Kind.ANSWER]),
    session=U16,
    sequence=U32,
    nonce=st.binary(min_size=16, max_size=16),
    vehicle_nonce=st.binary(min_size=16, max_size=16),
    text=st.text(max_size=200),
)
MESSAGES = st.one_of(ups(), REPORTS, PLANS, TEXTS)
