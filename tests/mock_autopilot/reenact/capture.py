"""A recorded session out of its telemetry logs: who sent what to PX4, and what PX4 told.

The onboard log has both directions between the companion and PX4; a ground-station log of the same session, if there
is one, adds what the pilot sent. Without it the pilot is believed to have been there, hands off.
"""

import itertools
import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mock_autopilot.px4.params import ParamTable, UnknownParamError
from tests.mock_autopilot.reenact.events import Event, EventReader, param_value
from tests.mock_autopilot.reenact.pilot import inferred_pilot
from tests.mock_autopilot.reenact.session import GCS, ONBOARD, Pose, SentFrame, Session, Setpoint, Sticks
from tests.mock_autopilot.reenact.tlog import Decoder, Frame, TlogError, read

PX4 = 1
STREAMED = {"SET_ATTITUDE_TARGET", "VISION_POSITION_ESTIMATE", "MANUAL_CONTROL", "PING", "TIMESYNC"}
"""Inputs kept as numbers, or left out: PING and TIMESYNC change nothing."""
TOLD = {
    "HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE", "BATTERY_STATUS", "STATUSTEXT", "ESTIMATOR_STATUS",
}  # fmt: skip
ASK_FOR_ONE = {"PARAM_REQUEST_READ", "PARAM_SET"}
BOOT_FIRST_HEARTBEAT_S = (0.9, 1.2)
DEAD_AFTER_S = 1.0
"""PX4 that streams is never silent for so long."""
IN_FLIGHT_M = 0.5

Messages = list[tuple[float, Frame, Any]]


def capture(paths: Sequence[Path]) -> Session:
    """Make a session of the logs of one recording; TlogError says in a sentence why that cannot be."""
    onboard = [path for path in paths if ".gcs." not in path.name]
    if len(onboard) != 1:
        raise TlogError("give one log of the link between companion and PX4, and beside it at most the .gcs. one")
    messages = _decoded(read(onboard[0]), 0.0)
    boot_s = _boot_s(onboard[0], messages)
    messages = [(at_s - boot_s, frame, message) for at_s, frame, message in messages]
    pilots = [path for path in paths if path not in onboard]
    gcs = [one for path in pilots for one in _decoded(read(path), boot_s)]
    return _session(session_name(onboard[0]), messages, gcs)


def session_name(path: Path) -> str:
    """Return the name that the logs of one session share."""
    return path.name.split(".")[0]


def _decoded(frames: Iterable[Frame], from_s: float) -> Messages:
    decoder = Decoder()
    return [(frame.at_s - from_s, frame, decoder.message(frame)) for frame in frames]


def _boot_s(path: Path, messages: Messages) -> float:
    """Return when PX4 sent its first frame; only a session that begins with its boot can be re-enacted."""
    told = [at_s for at_s, frame, _ in messages if frame.system == PX4]
    beats = [at_s for at_s, frame, message in messages if frame.system == PX4 and frame.id == 0 and message]
    if not beats:
        raise TlogError(f"{path} holds no HEARTBEAT of PX4")
    least_s, most_s = BOOT_FIRST_HEARTBEAT_S
    if not least_s <= beats[0] - told[0] <= most_s:
        raise TlogError(f"{path} does not begin with PX4's boot: record from before PX4 starts")
    return told[0]


def _session(name: str, messages: Messages, gcs: Messages) -> Session:
    ours = [one for one in messages if one[1].system == PX4]
    companions = _companions(messages)
    sent = [one for one in messages if one[1].system in companions]
    known = companions | {PX4}
    pilot = [one for one in gcs if one[1].system not in known]
    poses = _poses(sent)
    setpoints = _setpoints(sent)
    silent_s = _silences(ours)
    events = _events(ONBOARD, ours, silent_s, _asked_from(sent)) + _events(GCS, _of_px4(gcs), silent_s, {})
    ends_s = max(at_s for at_s, *_ in messages)
    frames = _rare(ONBOARD, sent) + _rare(GCS, pilot)
    sticks, inferred = _sticks(pilot), list[str]()
    if not gcs:
        more, sticks, inferred = inferred_pilot(_forwarded(messages, known), frames, events, silent_s, ends_s)
        frames += more
    return Session(
        name=name,
        params=_params(ours),
        hover_thrust=_hover_thrust(setpoints, poses),
        start_yaw_rad=_start_yaw_rad(sent),
        sunk_m=_sunk_m(ours),
        ends_at_s=round(ends_s, 3),
        silent_s=silent_s,
        frames=sorted(frames, key=lambda frame: frame.at_s),
        setpoints=setpoints,
        poses=poses,
        sticks=sticks,
        events=sorted(events, key=lambda event: event.at_s),
        told=_told(ours),
        inferred=inferred,
        cuts=[],
    )


def _companions(messages: Messages) -> set[int]:
    """Those who fly: other systems' frames on this link are forwarded by PX4."""
    asks = {"COMMAND_LONG", "SET_ATTITUDE_TARGET", "VISION_POSITION_ESTIMATE", "PARAM_REQUEST_READ"}
    return {frame.system for _, frame, m in messages if frame.system != PX4 and m is not None and m.get_type() in asks}


def _of_px4(gcs: Messages) -> Messages:
    return [one for one in gcs if one[1].system == PX4]


def _forwarded(messages: Messages, known: set[int]) -> Messages:
    return [one for one in messages if one[1].system not in known]


def _rare(link: str, sent: Messages) -> list[SentFrame]:
    return [
        SentFrame(at_s=at_s, link=link, raw=frame.raw)
        for at_s, frame, message in sent
        if message is not None and message.get_type() not in STREAMED
    ]


def _told(ours: Messages) -> list[SentFrame]:
    """Keep what tells PX4's state."""
    return [
        SentFrame(at_s=at_s, link=ONBOARD, raw=frame.raw)
        for at_s, frame, message in ours
        if message is not None and message.get_type() in TOLD
    ]


def _setpoints(sent: Messages) -> list[Setpoint]:
    out = []
    for at_s, _, m in sent:
        if m is not None and m.get_type() == "SET_ATTITUDE_TARGET":
            w, x, y, z = m.q
            out.append(Setpoint(at_s=at_s, q_wxyz=(w, x, y, z), thrust=m.thrust))
    return out


def _poses(sent: Messages) -> list[Pose]:
    seen = [(at_s, m) for at_s, _, m in sent if m is not None and m.get_type() == "VISION_POSITION_ESTIMATE"]
    if not seen:
        return []
    first = seen[0][1]
    return [Pose(at_s=at_s, position_m=(m.x - first.x, m.y - first.y, m.z - first.z)) for at_s, m in seen]


def _start_yaw_rad(sent: Messages) -> float:
    yaws = (m.yaw for _, _, m in sent if m is not None and m.get_type() == "VISION_POSITION_ESTIMATE")
    return round(next(yaws, 0.0), 4)


def _sunk_m(ours: Messages) -> float:
    """Return the last distance below zero, m; the sensor counts in 16 bits without a sign."""
    told = [m.current_distance for _, _, m in ours if m is not None and m.get_type() == "DISTANCE_SENSOR"]
    return (65536 - told[-1]) / 100.0 if told and told[-1] > 32767 else 0.0


def _sticks(pilot: Messages) -> list[Sticks]:
    return [
        Sticks(at_s=at_s, x=m.x, y=m.y, z=m.z, r=m.r, buttons=m.buttons)
        for at_s, _, m in pilot
        if m is not None and m.get_type() == "MANUAL_CONTROL"
    ]


def _params(ours: Messages) -> dict[str, float]:
    """PX4 announces what differs from its defaults when it boots; what was read later counts, too."""
    table, out = ParamTable(), dict[str, float]()
    for _, _, m in ours:
        if m is None or m.get_type() != "PARAM_VALUE" or m.param_id in out:
            continue
        try:
            before = table[m.param_id] if table.find(m.param_id) else math.nan
            after = table.change(m.param_id, param_value(m)).value
        except UnknownParamError:
            continue
        if before != after and not m.param_id.startswith(("CAL_", "SYS_AUTO", "SENS_")):
            out[m.param_id] = round(after, 7)
    return out


def _silences(ours: Messages) -> list[tuple[float, float]]:
    """Return from when until when PX4 said nothing at all: it was dead, and booted then."""
    times = [at_s for at_s, *_ in ours]
    gaps = itertools.pairwise(times)
    return [(round(last_s, 3), round(next_s, 3)) for last_s, next_s in gaps if next_s - last_s > DEAD_AFTER_S]


def _asked_from(sent: Messages) -> dict[str, float]:
    """Return when each parameter was asked for first."""
    asked = [(m.param_id, at_s) for at_s, _, m in sent if m is not None and m.get_type() in ASK_FOR_ONE]
    return dict(reversed(asked))


def _events(link: str, ours: Messages, silent_s: list[tuple[float, float]], asked_s: dict[str, float]) -> list[Event]:
    """Read PX4's messages, with a new state after each boot."""
    out: list[Event] = []
    boots = [0.0, *(on_s for _, on_s in silent_s), math.inf]
    for start_s, end_s in itertools.pairwise(boots):
        reader = EventReader(link)
        for at_s, _, message in ours:
            if message is not None and start_s <= at_s < end_s and _is_told(message, at_s, asked_s):
                reader.take(at_s, message)
        out += reader.events
    return out


def _is_told(message: Any, at_s: float, asked_s: dict[str, float]) -> bool:
    """Parameters announced unasked are no events."""
    return message.get_type() != "PARAM_VALUE" or at_s >= asked_s.get(message.param_id, math.inf)


def _hover_thrust(setpoints: list[Setpoint], poses: list[Pose]) -> float:
    """Return the median thrust while it was in the air; half when it never was."""
    if not poses:
        return 0.5
    times, heights = [pose.at_s for pose in poses], [-pose.position_m[2] for pose in poses]
    there = np.interp([one.at_s for one in setpoints], times, heights) > IN_FLIGHT_M
    flown = [one.thrust for one, high in zip(setpoints, there, strict=True) if high]
    return round(statistics.median(flown), 4) if flown else 0.5
