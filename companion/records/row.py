"""A tick as one flat row: numbers in one block of float64, words only when they change.

Which numbers there are differs: with a new frame or without, on the ground or flown by a law, whose inner signals are
its own. Each such kind of tick has a layout, which is sent once, before its first row.
"""

import json
import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from companion.estimation.state import Counts
from companion.records.exact import to_json
from companion.supervisor.faults import Event, reaction_to
from companion.supervisor.flight import Phase
from companion.tick import Tick
from companion.types import Array

ROW, LAYOUT, START, BEGIN, TOLD, BATCH = b"R", b"L", b"S", b"B", b"T", b"P"
"""First byte of a message: what it is."""
_HEAD = struct.Struct("<cHII")
"""Kind of message, layout, the tick's number, bytes of words."""
_LENGTH = struct.Struct("<I")
_F64 = np.dtype(np.float64)
_RESTING = frozenset({Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED, Phase.HANDED_OVER})

Shape = tuple[int, ...]
Column = tuple[str, str, Shape]
"""Topic, name, and shape: () for a number."""
_WANTED = "accel_w_mps2"
TIME = 0
"""Place of `time_s` in every row's block."""

# Topic, names of its numbers, names of its arrays; the functions below give the values in the same order.
_BASE = {
    "/flight": ("time_s late_s age_s sent_s airborne touched_down since_s theirs level takeoff_height_m", ""),
    "/autopilot": (
        "connected heartbeat_s armed in_air battery_fraction battery_v heard_s attitude_s boot_s",
        "autopilot_q_w_flu_wxyz",
    ),
}
_FRAME = {
    "/mocap": (
        "frame_number frame_stamp_s frame_received_s frame_residual_m frame_late",
        "frame_position_w_m frame_rotation_w_b",
    )
}
_ESTIMATE = {
    "/estimate": (
        "estimate_run estimate_agreeing estimate_stamp_s estimate_clock_offset_s "
        + " ".join(f"estimate_{count.name}" for count in fields(Counts)),
        "",
    )
}
_VEHICLE = {"/estimate": ("vehicle_time_s", "position_w_m velocity_w_mps q_w_flu_wxyz rate_flu_radps")}
_REFERENCE = {
    "/reference": (
        "reference_yaw_rad",
        "reference_position_w_m reference_velocity_w_mps reference_acceleration_w_mps2",
    )
}
_ASKED = {
    "/given": (
        "given_age_s given_reference_yaw_rad given_dt_s begun",
        "given_position_w_m given_velocity_w_mps given_q_w_flu_wxyz given_rate_flu_radps "
        "given_reference_position_w_m given_reference_velocity_w_mps given_reference_acceleration_w_mps2 "
        "given_sent_accel_w_mps2 given_known_accel_w_mps2",
    ),
    "/law": ("event", ""),
}
_GATED = {
    "/setpoint": (
        "setpoint_thrust cut_not_finite cut_tilt cut_thrust cut_slew cut_age cut_fence",
        "setpoint_q_w_flu_wxyz",
    )
}
_ARMS = {
    "/arms": (
        "arm_bus_cycles arm_bus_cycle_s arm_bad_packets",
        "joint_read_s joint_position_rad joint_velocity_radps joint_effort joint_temperature_c joint_voltage_v "
        "joint_torque_on joint_held_rad arms_known_accel_w_mps2",
    )
}
_GOAL = {"/arms": ("", "joint_goal_rad joint_goal_velocity_radps joint_goal_acceleration_radps2")}
WORDS = (
    "phase", "reason", "cause", "mode", "autopilot_text", "verdict", "law_name", "guard_failure", "arm_phase",
    "arm_reason",
)  # fmt: skip
"""Names of the words of every row; `events` and `arm_faults`, lists of tables, come on top."""


@dataclass(frozen=True)
class Signals:
    """What the law wants and its inner values, in one block."""

    columns: tuple[Any, ...]
    """Their names, then the shape of each."""
    block: bytes


Frozen = tuple[list[Array], bytes]
"""Arrays, of which only type and shape still count, and what was in them."""


@dataclass
class _Values:
    """What is gathered of one tick."""

    parts: list[dict[str, tuple[str, str]]] = field(default_factory=list)
    numbers: list[Any] = field(default_factory=list)
    arrays: list[Array] = field(default_factory=list)


@dataclass(frozen=True)
class _Known:
    """A layout that was sent."""

    number: int
    pack: Callable[..., bytes]
    size: int


def batch(messages: list[bytes]) -> bytes:
    """Several messages as one."""
    return BATCH + b"".join([part for message in messages for part in (_LENGTH.pack(len(message)), message)])


def unbatched(message: bytes) -> Iterator[bytes]:
    """The messages in a BATCH, in order."""
    at = 1
    while at < len(message):
        (length,) = _LENGTH.unpack_from(message, at)
        at += _LENGTH.size + length
        yield message[at - length : at]


class RowEncoder:
    """Ticks to messages. Holds which layouts and words the other side has; `retell` when it has them no more."""

    def __init__(self) -> None:
        self.number = 0
        """Of the next row."""
        self.retell()

    def retell(self) -> None:
        """Something was lost on the way: all is told again. The count of ticks goes on, so that a gap shows."""
        self._layouts: dict[Any, _Known] = {}
        self._words: tuple[Any, ...] = ()
        self._phase: Phase | None = None

    def messages(self, tick: Tick, kept: Frozen) -> list[bytes]:
        """What is to be sent of this tick and of what was `frozen` of it, in order; the row is the last."""
        before: list[bytes] = []
        phase = tick.flight.phase
        if phase is not self._phase:
            if phase is not Phase.STANDBY and (self._phase is None or self._phase in _RESTING):
                before.append(START + _start(tick, self.number).encode())
            self._phase = phase
        values, signals = _gathered(tick), _signals(tick, kept)
        key = (*map(id, values.parts), signals.columns)
        known = self._layouts.get(key)
        if known is None:
            known = self._layouts[key] = _known(len(self._layouts), values, signals)
            before.append(LAYOUT + json.dumps([known.number, _columns(values, signals)]).encode())
        words = self._changed_words(tick)
        block = b"".join([
            _HEAD.pack(ROW, known.number, self.number, len(words)),
            words,
            _packed(known, values.numbers),
            _joined(values.arrays),
            signals.block,
        ])  # fmt: skip
        if len(block) != _HEAD.size + len(words) + known.size:
            raise ValueError(f"a row of {len(block)} bytes does not fit its layout")
        self.number += 1
        before.append(block)
        return before

    def _changed_words(self, tick: Tick) -> bytes:
        """All words as JSON where one has changed, else nothing."""
        flight, arms = tick.flight, tick.arms
        words = (
            flight.phase,
            flight.reason,
            flight.cause,
            tick.status.mode,
            tick.status.last_text,
            tick.estimate.verdict if tick.estimate is not None else None,
            tick.law,
            tick.gated.failure if tick.gated is not None else "",
            arms.phase if arms is not None else None,
            arms.reason if arms is not None else None,
            tick.events,
            arms.status.faults if arms is not None else (),
            flight.stage if tick.events else None,
        )
        if words == self._words:
            return b""
        self._words = words
        said = {name: word or "" for name, word in zip(WORDS, words, strict=False)}
        events = [_event(event, tick) for event in tick.events]
        faults = [{"joint": f.joint, "kind": f.kind, "text": f.text} for f in arms.status.faults] if arms else []
        return json.dumps(said | {"events": events, "arm_faults": faults}).encode()


def _packed(known: _Known, numbers: list[Any]) -> bytes:
    try:
        return known.pack(*numbers)
    except struct.error:  # a device that does not know yet, or a law that says None for a number
        return known.pack(*[math.nan if number is None else float(number) for number in numbers])


def _joined(arrays: list[Array]) -> bytes:
    try:
        return b"".join(arrays)  # type: ignore[arg-type]  # numpy's arrays are bytes to join
    except TypeError:  # a view that is not one piece of memory
        return b"".join([array.tobytes() for array in arrays])


def _event(event: Event, tick: Tick) -> dict[str, str]:
    reaction = reaction_to(event.fault, tick.flight.stage)
    return {"fault": event.fault, "text": event.text, "reaction": reaction.words}


def _start(tick: Tick, number: int) -> str:
    """Where a replay may begin: what the estimator knew after this tick's frame."""
    return to_json({"time_s": tick.time_s, "number": number, "phase": tick.flight.phase, "estimate": tick.estimate})


def _gathered(tick: Tick) -> _Values:
    """Numbers and arrays of all parts that this tick has; a part's names stand above."""
    status, flight = tick.status, tick.flight
    parts = [_BASE]
    numbers: list[Any] = [
        tick.time_s, tick.late_s, tick.age_s, tick.sent_s, flight.airborne, flight.touched_down, flight.since_s,
        flight.theirs, flight.level, flight.takeoff_height_m,
        status.connected, status.heartbeat_s, status.armed, status.in_air, status.battery_fraction, status.battery_v,
        status.heard_s, status.attitude_s, status.boot_s,
    ]  # fmt: skip
    arrays = [status.q_w_flu_wxyz]
    if (frame := tick.frame) is not None:
        parts.append(_FRAME)
        numbers += (frame.frame, frame.stamp_s, frame.received_s, frame.residual_m, frame.late)
        arrays += (frame.position_w_m, frame.rotation_w_b)
    if (estimate := tick.estimate) is not None:
        parts.append(_ESTIMATE)
        numbers += (estimate.run, estimate.agreeing, estimate.stamp_s, estimate.clock.offset_s)
        numbers += vars(estimate.counts).values()
    if (vehicle := tick.vehicle) is not None:
        parts.append(_VEHICLE)
        numbers.append(vehicle.time_s)
        arrays += (vehicle.position_w_m, vehicle.velocity_w_mps, vehicle.q_w_flu_wxyz, vehicle.rate_flu_radps)
    if (reference := tick.reference) is not None:
        parts.append(_REFERENCE)
        numbers.append(reference.yaw_rad)
        arrays += (reference.position_w_m, reference.velocity_w_mps, reference.acceleration_w_mps2)
    if (asked := tick.asked) is not None:
        parts.append(_ASKED)
        given, ahead = asked.given, asked.given.reference
        numbers += (given.age_s, ahead.yaw_rad, given.dt_s, asked.begun, bool(asked.output.event.any()))
        arrays += (
            given.position_w_m, given.velocity_w_mps, given.q_w_flu_wxyz, given.rate_flu_radps,
            ahead.position_w_m, ahead.velocity_w_mps, ahead.acceleration_w_mps2,
            given.sent_accel_w_mps2, given.known_accel_w_mps2,
        )  # fmt: skip
    if (gated := tick.gated) is not None:
        parts.append(_GATED)
        numbers += (
            gated.setpoint.thrust, gated.not_finite, gated.tilt_cut, gated.thrust_cut, gated.slew_cut, gated.age_cut,
            gated.fence_cut,
        )  # fmt: skip
        arrays.append(gated.setpoint.q_w_flu_wxyz)
    if tick.arms is not None:
        _gather_arms(tick, parts, numbers, arrays)
    return _Values(parts, numbers, arrays)


def _gather_arms(tick: Tick, parts: list[Any], numbers: list[Any], arrays: list[Array]) -> None:
    assert tick.arms is not None
    status, goal = tick.arms.status, tick.arms.goal
    parts.append(_ARMS)
    numbers += (status.cycles, status.cycle_s, status.bad_packets)
    arrays += (
        status.read_s, status.position_rad, status.velocity_radps, status.effort, status.temperature_c,
        status.voltage_v, status.torque_on.astype(_F64), status.held_rad, tick.arms.known_accel_w_mps2,
    )  # fmt: skip
    if goal is not None:
        parts.append(_GOAL)
        arrays += (goal.position_rad, goal.velocity_radps, goal.acceleration_radps2)


def frozen(tick: Tick) -> Frozen:
    """What the law wants and its inner values as they are now: a user's law may go on to write into its arrays.

    For every tick at once, and cheap: the bytes alone are copied.
    """
    asked = tick.asked
    if asked is None:
        arrays = [*tick.late_signals.values()]
    else:
        arrays = [asked.output.accel_w_mps2, *asked.output.signals.values(), *tick.late_signals.values()]
    try:
        return arrays, b"".join(arrays)  # type: ignore[arg-type]
    except TypeError:  # not one piece of memory, or what a user's law calls an array
        arrays = [_array(array) for array in arrays]
        return arrays, b"".join(arrays)  # type: ignore[arg-type]


def _array(signal: Any) -> Array:
    """In one piece; NaN where it is no number."""
    try:
        return np.array(signal, _F64, order="C")
    except (TypeError, ValueError):
        return np.array(math.nan)


def _signals(tick: Tick, kept: Frozen) -> Signals:
    """Of `frozen` values what a row needs."""
    arrays, block = kept
    names = (*tick.late_signals,)
    if tick.asked is not None:
        names = (_WANTED, *tick.asked.output.signals, *names)
    if any(array.dtype is not _F64 and array.dtype != _F64 for array in arrays):
        arrays, block = _as_f64(arrays, block)
    return Signals((names, *[array.shape for array in arrays]), block)


def _as_f64(arrays: list[Array], block: bytes) -> Frozen:
    """A user's law may have integers or short floats among its arrays."""
    copies, at = [], 0
    for array in arrays:
        piece = block[at : at + array.nbytes]
        at += array.nbytes
        if array.dtype.kind in "fiub":
            copies.append(np.frombuffer(piece, array.dtype).astype(_F64).reshape(array.shape))
        else:
            copies.append(np.array(math.nan))
    return copies, b"".join(copies)  # type: ignore[arg-type]


def _known(number: int, values: _Values, signals: Signals) -> _Known:
    pack = struct.Struct(f"<{len(values.numbers)}d").pack
    cells = sum(math.prod(shape) for _, _, shape in _columns(values, signals))
    return _Known(number, pack, cells * _F64.itemsize)


def _columns(values: _Values, signals: Signals) -> list[Column]:
    """Numbers first, then arrays, in the order in which they were gathered."""
    numbers: list[Column] = []
    arrays: list[tuple[str, str]] = []
    for part in values.parts:
        for topic, (of_numbers, of_arrays) in part.items():
            numbers += [(topic, name, ()) for name in of_numbers.split()]
            arrays += [(topic, name) for name in of_arrays.split()]
    if len(numbers) != len(values.numbers):
        raise ValueError(f"{len(values.numbers)} numbers of a tick have {len(numbers)} names")
    shaped = [(topic, name, array.shape) for (topic, name), array in zip(arrays, values.arrays, strict=True)]
    names, *shapes = signals.columns
    of_law = [
        ("/law", name if name == _WANTED else f"law_{name}", shape) for name, shape in zip(names, shapes, strict=True)
    ]
    return numbers + shaped + of_law


class Layout:
    """What the numbers of a row mean; the same object in every row of its kind."""

    def __init__(self, columns: list[Column]) -> None:
        self.columns = tuple(columns)
        self._places: dict[str, tuple[int, int, Shape]] = {}
        at = 0
        for _, name, shape in columns:
            self._places[name] = (at, at + math.prod(shape), shape)
            at += math.prod(shape)

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def cell(self, name: str, block: Array) -> Array:
        """A column's value, in its shape."""
        begin, end, shape = self._places[name]
        return block[begin:end].reshape(shape)


@dataclass(frozen=True)
class Row:
    """A row on the other side."""

    number: int
    layout: Layout
    block: Array
    """The numbers of all columns, one after the other."""
    words: dict[str, Any]
    """As they stand now: WORDS, `events` and `arm_faults`; the same object until one changes."""

    def __contains__(self, name: str) -> bool:
        return name in self.layout

    def cell(self, name: str) -> Array:
        """A column's value, in its shape."""
        return self.layout.cell(name, self.block)


class RowDecoder:
    """The other side of RowEncoder."""

    def __init__(self) -> None:
        self._layouts: dict[int, Layout] = {}
        self._words: dict[str, Any] = {}

    def learn(self, message: bytes) -> None:
        """A message LAYOUT."""
        number, columns = json.loads(message[1:])
        self._layouts[number] = Layout([(topic, name, tuple(shape)) for topic, name, shape in columns])

    def row(self, message: bytes) -> Row:
        """A message ROW; KeyError when its layout got lost."""
        _, layout, number, words = _HEAD.unpack_from(message)
        if words:
            self._words = json.loads(message[_HEAD.size : _HEAD.size + words])
        block = np.frombuffer(message, _F64, offset=_HEAD.size + words)
        return Row(number, self._layouts[layout], block, self._words)
