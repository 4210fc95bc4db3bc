"""One recorded session: what PX4 heard, what it told, and the small file both are kept in."""

import gzip
import json
from dataclasses import asdict, dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

from tests.mock_autopilot.reenact.events import Event

ONBOARD, GCS = "onboard", "gcs"
MS = 1e3
ANGLE = 1e4
"""Quaternions and thrust are kept to 1e-4, places to 1 mm, times to 1 ms."""


@dataclass(frozen=True, kw_only=True)
class SentFrame:
    """A recorded frame to PX4, byte by byte."""

    at_s: float
    link: str
    raw: bytes


@dataclass(frozen=True, kw_only=True)
class Setpoint:
    """One SET_ATTITUDE_TARGET: attitude (w x y z, NED/FRD) and thrust 0..1."""

    at_s: float
    q_wxyz: tuple[float, float, float, float]
    thrust: float


@dataclass(frozen=True, kw_only=True)
class Pose:
    """One VISION_POSITION_ESTIMATE, from where the vehicle stood first (NED, m)."""

    at_s: float
    position_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Sticks:
    """One input of the sticks, MANUAL_CONTROL."""

    at_s: float
    x: int
    y: int
    z: int
    r: int
    buttons: int


@dataclass(frozen=True, kw_only=True)
class Cut:
    """A stretch left out of the recording, in which the flight only went on."""

    at_s: float
    for_s: float


@dataclass(frozen=True, kw_only=True)
class Session:
    """Everything needed to re-enact one recording; times count from PX4's first frame."""

    name: str
    params: dict[str, float]
    hover_thrust: float
    start_yaw_rad: float
    sunk_m: float
    """Depth below its floor at which the recorded simulator stopped the vehicle, by the distance sensor."""
    ends_at_s: float
    silent_s: list[tuple[float, float]]
    """Beginning and end of each time in which PX4 was dead."""
    frames: list[SentFrame]
    setpoints: list[Setpoint]
    poses: list[Pose]
    sticks: list[Sticks]
    events: list[Event]
    told: list[SentFrame]
    """PX4's messages to the companion about its state, for tests of the companion's own reader."""
    inferred: list[str]
    """Inputs that no log shows and only PX4's reaction tells."""
    cuts: list[Cut]


def save(session: Session, path: Path) -> None:
    """Write the small file; the same session gives the same bytes."""
    text = json.dumps(_packed(session), separators=(",", ":"), sort_keys=True)
    path.write_bytes(gzip.compress(text.encode(), mtime=0))


def load(path: Path) -> Session:
    """Read a session from a file that `save` wrote."""
    return _unpacked(json.loads(gzip.decompress(path.read_bytes())))


def _packed(session: Session) -> dict[str, Any]:
    plain = {key: getattr(session, key) for key in PLAIN}
    return {
        **plain,
        "cuts": [asdict(cut) for cut in session.cuts],
        "events": [[round(e.at_s, 3), e.link, e.channel, e.what] for e in session.events],
        "frames": [[round(one.at_s, 3), one.link, one.raw.hex()] for one in session.frames],
        "told": [[round(one.at_s, 3), one.link, one.raw.hex()] for one in session.told],
        "setpoints": _columns(
            [(s.at_s * MS, *(ANGLE * q for q in s.q_wxyz), ANGLE * s.thrust) for s in session.setpoints]
        ),
        "poses": _columns([(p.at_s * MS, *(MS * x for x in p.position_m)) for p in session.poses]),
        "sticks": _columns([(s.at_s * MS, s.x, s.y, s.z, s.r, s.buttons) for s in session.sticks]),
    }


PLAIN = ("name", "params", "hover_thrust", "start_yaw_rad", "sunk_m", "ends_at_s", "silent_s", "inferred")


def _unpacked(values: dict[str, Any]) -> Session:
    plain = {key: values[key] for key in PLAIN}
    return Session(
        **{**plain, "silent_s": [(off_s, on_s) for off_s, on_s in plain["silent_s"]]},
        cuts=[Cut(**cut) for cut in values["cuts"]],
        events=[
            Event(at_s=at_s, link=link, channel=channel, what=what) for at_s, link, channel, what in values["events"]
        ],
        frames=[_frame(*one) for one in values["frames"]],
        told=[_frame(*one) for one in values["told"]],
        setpoints=[
            Setpoint(at_s=t / MS, q_wxyz=(w / ANGLE, x / ANGLE, y / ANGLE, z / ANGLE), thrust=thrust / ANGLE)
            for t, w, x, y, z, thrust in _rows(values["setpoints"])
        ],
        poses=[Pose(at_s=t / MS, position_m=(x / MS, y / MS, z / MS)) for t, x, y, z in _rows(values["poses"])],
        sticks=[Sticks(at_s=t / MS, x=x, y=y, z=z, r=r, buttons=b) for t, x, y, z, r, b in _rows(values["sticks"])],
    )


def _frame(at_s: float, link: str, raw: str) -> SentFrame:
    return SentFrame(at_s=at_s, link=link, raw=bytes.fromhex(raw))


def _columns(rows: list[tuple[float, ...]]) -> list[list[int]]:
    """Whole numbers, column by column, each less its predecessor: that packs well."""
    columns = [[round(value) for value in column] for column in zip(*rows, strict=True)]
    return [[after - before for before, after in zip([0, *column], column, strict=False)] for column in columns]


def _rows(columns: list[list[int]]) -> list[tuple[int, ...]]:
    return list(zip(*(accumulate(column) for column in columns), strict=True))
