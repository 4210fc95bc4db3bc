"""Messages of the law's link: little-endian structures, and JSON where a message is rare. Pure.

Up is from the ground to the vehicle. Times are ticks of 0.1 ms on the sender's monotonic clock, 32 bits that wrap after
119 hours. The key's tag (`sealing.py`) follows each message.
"""

from dataclasses import dataclass, field
from enum import IntEnum, IntFlag

from companion.core.types import Vec3

TICK_S = 1e-4
"""Resolution of the stamps."""
PROTOCOL = 1
"""Version of the messages; ends of different versions do not connect."""
WRAP = 1 << 32


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
    return round(time_s / TICK_S) % WRAP


def short_ticks(time_s: float) -> int:
    """Return a duration (s) in ticks, kept in 0 to 65535."""
    return min(max(round(time_s / TICK_S), 0), 65535)


def seconds_between(stamp: int, earlier: int) -> float:
    """Return the time from one stamp to another (s), in -60 to 60 hours: stamps wrap."""
    ticks = (stamp - earlier) % WRAP
    return (ticks - WRAP if ticks >= WRAP // 2 else ticks) * TICK_S


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
    """Flight, counted at lift-off from 1 to 15, that the command belongs to."""
    law: int = 0
    """Number of the law that computes, counted at each switch from 0 to 15."""
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


MESSAGE = Text | UpMessage | Report | Plan


def is_number_newer(number: int, than: int) -> bool:
    """Return True if a 16-bit command number follows another, over the wrap."""
    return 0 < (number - than) % 65536 < 32768
