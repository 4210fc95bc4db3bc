"""The pilot of a session without a log of his link: there, hands off, until PX4 reacts to what no companion asked.

Each of his actions is put in before PX4's reaction by as much as PX4 was recorded to take for it.
"""

import itertools
import math
import re
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.px4.commander import AUTO_SUB_MODES, MAIN_MODES
from mock_autopilot.px4.vocabulary import AUTO_MAIN_MODE, Mode
from tests.mock_autopilot.reenact.events import Event
from tests.mock_autopilot.reenact.session import GCS, SentFrame, Sticks
from tests.mock_autopilot.reenact.tlog import Decoder, Frame

PILOT, PILOT_COMPONENT = 255, 190
BEFORE_BOOT_S = 1.0
STICKS_PERIOD_S = 0.042
"""A joystick on a ground station, recorded at 24 Hz."""
THROTTLE_MIDDLE = 500
LOSS_TO_FAILSAFE_S = 0.643
"""The last MANUAL_CONTROL to "Failsafe activated", recorded with COM_RC_LOSS_T = 0.5."""
COMMAND_TO_MODE_S = 0.055
COMMAND_TO_TEXT_S = 0.008
STICKS_TO_MODE_S = 0.06
STICKS_HELD_S, STICKS_PUSHED = 1.0, 600
CAUSED_WITHIN_S = 0.3
"""A mode that comes so soon after a command of the companion's, or a disarm, is due to it."""
MODE_COMMANDS = {20, 21, 22, 176, 400}

Inferred = tuple[list[SentFrame], list[Sticks], list[str]]


def inferred_pilot(
    forwarded: Sequence[tuple[float, Frame, Any]],
    sent: Sequence[SentFrame],
    events: Sequence[Event],
    silent_s: Sequence[tuple[float, float]],
    ends_s: float,
) -> Inferred:
    """Return what the pilot must have sent, and in words what of it is a conclusion."""
    beats = [(at_s, frame.raw) for at_s, frame, m in forwarded if m is not None and m.get_type() == "HEARTBEAT"]
    if not beats:
        return [], [], []
    frames = [SentFrame(at_s=at_s, link=GCS, raw=raw) for at_s, raw in _from_boot_on(beats)]
    causes = [at_s for at_s, command in _commands(sent) if command in MODE_COMMANDS]
    modes, words = _modes(events, [*causes, *_boots(silent_s, events)])
    pushed_s = [event.at_s - STICKS_TO_MODE_S for event in events if "using sticks" in event.what]
    lost_s = _lost_s(events)
    words += [f"{at_s:.2f} s: the sticks are moved" for at_s in pushed_s]
    words += [f"{lost_s:.2f} s: the last MANUAL_CONTROL"] if math.isfinite(lost_s) else []
    return frames + modes, _sticks(min(ends_s, lost_s), pushed_s), words


def _boots(silent_s: Sequence[tuple[float, float]], events: Sequence[Event]) -> list[float]:
    """Return when PX4 first reported its mode after a boot: no client requested that mode."""
    told = [[e.at_s for e in events if e.channel == "CURRENT_MODE" and e.at_s > on_s] for _, on_s in silent_s]
    return [times[0] for times in told if times]


def _from_boot_on(beats: list[tuple[float, bytes]]) -> list[tuple[float, bytes]]:
    """PX4 forwards a HEARTBEAT only to who was heard; the station was there before."""
    first_s, raw = beats[0]
    earlier = [(first_s - count, raw) for count in range(1, math.floor(first_s + BEFORE_BOOT_S) + 1)]
    return earlier[::-1] + beats


def _commands(sent: Sequence[SentFrame]) -> list[tuple[float, int]]:
    decoder = Decoder()
    messages = [(one.at_s, decoder.message(Frame(at_s=one.at_s, raw=one.raw))) for one in sent]
    return [
        (at_s, m.command) for at_s, m in messages if m is not None and m.get_type() in {"COMMAND_LONG", "COMMAND_INT"}
    ]


def _modes(events: Sequence[Event], causes: Sequence[float]) -> tuple[list[SentFrame], list[str]]:
    """DO_SET_MODE for every mode that came, or was refused, without a request of another client."""
    frames, words = [], []
    causes = [*causes, *(event.at_s - 0.1 for event in events if "Disarmed" in event.what)]
    modes = [event for event in events if event.channel == "CURRENT_MODE"]
    for before, event in itertools.pairwise(modes):
        by_itself = "wanted" in event.what or "wanted" in before.what
        if not by_itself and not _caused(event.at_s, causes) and not _by_sticks(event, events):
            main, sub = (int(part) for part in event.what.split("/"))
            frames.append(_set_mode(event.at_s - COMMAND_TO_MODE_S, main, sub))
            words.append(f"{event.at_s - COMMAND_TO_MODE_S:.2f} s: the ground station asks for mode {event.what}")
    for event in events:
        refused = re.search(r"Switching to (\w+) is currently not available", event.what)
        if refused and not _caused(event.at_s, causes):
            main, sub = _number(refused[1])
            frames.append(_set_mode(event.at_s - COMMAND_TO_TEXT_S, main, sub))
            words.append(f"{event.at_s - COMMAND_TO_TEXT_S:.2f} s: the ground station asks for {refused[1]}")
    return frames, words


def _caused(at_s: float, causes: Sequence[float]) -> bool:
    return any(0.0 <= at_s - cause_s <= CAUSED_WITHIN_S for cause_s in causes)


def _by_sticks(mode: Event, events: Sequence[Event]) -> bool:
    return any("using sticks" in event.what and abs(event.at_s - mode.at_s) < CAUSED_WITHIN_S for event in events)


def _number(title: str) -> tuple[int, int]:
    """Return main and sub mode of a mode by the name PX4 gives it."""
    sub = next((sub for sub, mode in AUTO_SUB_MODES.items() if mode.title == title), 0)
    main = next((main for main, mode in MAIN_MODES.items() if mode.title == title), AUTO_MAIN_MODE)
    return (main, sub) if sub or main != AUTO_MAIN_MODE else (AUTO_MAIN_MODE, Mode.HOLD.value[1])


def _set_mode(at_s: float, main: int, sub: int) -> SentFrame:
    message = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1.0, float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
    raw = bytes(message.pack(mavlink.MAVLink(None, srcSystem=PILOT, srcComponent=PILOT_COMPONENT)))
    return SentFrame(at_s=at_s, link=GCS, raw=raw)


def _lost_s(events: Sequence[Event]) -> float:
    """Return when the sticks went silent: some time before PX4 noticed, infinite when it never did."""
    gone_s = next((e.at_s for e in events if e.what.endswith("-RC_RECEIVER") and "healthy" in e.what), math.inf)
    failsafe = [e.at_s for e in events if "Failsafe activated" in e.what and 0.0 <= gone_s - e.at_s < 1.0]
    return (failsafe[0] if failsafe else gone_s) - LOSS_TO_FAILSAFE_S


def _sticks(until_s: float, pushed_s: Sequence[float]) -> list[Sticks]:
    count = int((until_s + BEFORE_BOOT_S) / STICKS_PERIOD_S)
    times = [index * STICKS_PERIOD_S - BEFORE_BOOT_S for index in range(count)]
    return [_stick(at_s, any(0.0 <= at_s - start_s <= STICKS_HELD_S for start_s in pushed_s)) for at_s in times]


def _stick(at_s: float, pushed: bool) -> Sticks:
    return Sticks(at_s=at_s, x=STICKS_PUSHED if pushed else 0, y=0, z=THROTTLE_MIDDLE, r=0, buttons=0)
