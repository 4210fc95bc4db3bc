"""A tick as one flat row: numbers in one block of float64, words only when they change.

Which numbers there are differs: with a new frame or without, on the ground or flown by a law, whose inner signals are
its own. Each such kind of tick has a layout, which is sent once, before its first row.
"""

import json
import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.core.types import Array
from companion.flight.tick import Tick
from companion.records.exact_json import to_json
from companion.records.tick_columns import F64, Column, Frozen, Shape, Signals, Values, columns_of, gathered, signals_of
from companion.supervisor.faults import reaction_to
from companion.supervisor.flight_state import Phase

ROW, LAYOUT, START, BEGIN, EVENT, BATCH = b"R", b"L", b"S", b"B", b"T", b"P"
"""First byte of a message: what it is."""
_HEAD = struct.Struct("<cHII")
"""Kind of message, layout, the tick's number, bytes of words."""
_LENGTH = struct.Struct("<I")
_RESTING = frozenset({Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED, Phase.HANDED_OVER})
TIME = 0
"""Place of `time_s` in every row's block."""

WORDS = (
    "phase", "reason", "cause", "mode", "autopilot_text", "verdict", "law_name", "guard_failure", "arm_phase",
    "arm_reason",
)  # fmt: skip
"""Names of the words of every row; `events` and `arm_faults`, lists of tables, come on top."""


@dataclass(frozen=True)
class _Known:
    """Layout that has been sent."""

    number: int
    pack: Callable[..., bytes]
    size: int


def batch(messages: list[bytes]) -> bytes:
    """Return several messages packed into one BATCH message."""
    return BATCH + b"".join([part for message in messages for part in (_LENGTH.pack(len(message)), message)])


def unbatched(message: bytes) -> Iterator[bytes]:
    """Yield the messages in a BATCH, in order."""
    at = 1
    while at < len(message):
        (length,) = _LENGTH.unpack_from(message, at)
        at += _LENGTH.size + length
        yield message[at - length : at]


class RowEncoder:
    """Encoder of ticks; remembers the layouts and words it has sent, `retell` makes it send them again."""

    def __init__(self) -> None:
        self.number = 0
        """Number of the next row."""
        self.retell()

    def retell(self) -> None:
        """Send all layouts and words again after a loss. The tick count continues, so that the gap shows."""
        self._layouts: dict[Any, _Known] = {}
        self._words: tuple[Any, ...] = ()
        self._phase: Phase | None = None

    def messages(self, tick: Tick, kept: Frozen) -> list[bytes]:
        """Return the messages for this tick and its `frozen` values, in order; the row is the last."""
        before: list[bytes] = []
        phase = tick.flight.phase
        if phase is not self._phase:
            if phase is not Phase.STANDBY and (self._phase is None or self._phase in _RESTING):
                # a replay begins with the estimator's state after this tick's frame
                start = {"time_s": tick.time_s, "number": self.number, "phase": phase, "estimate": tick.estimate}
                before.append(START + to_json(start).encode())
            self._phase = phase
        values, signals = gathered(tick), signals_of(tick, kept)
        key = (*map(id, values.parts), signals.columns)
        known = self._layouts.get(key)
        if known is None:
            known = self._layouts[key] = _known(len(self._layouts), values, signals)
            before.append(LAYOUT + json.dumps([known.number, columns_of(values, signals)]).encode())
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
        """Return all words as JSON when one has changed, else nothing."""
        flight, arms = tick.flight, tick.arms
        words = (
            flight.phase,
            flight.reason,
            flight.cause,
            tick.status.mode,
            tick.status.last_text,
            tick.estimate.verdict if tick.estimate is not None else None,
            tick.law,
            tick.limited.failure if tick.limited is not None else "",
            arms.phase if arms is not None else None,
            arms.reason if arms is not None else None,
            tick.events,
            arms.status.faults if arms is not None else (),
            tick.stage if tick.events else None,
        )
        if words == self._words:
            return b""
        self._words = words
        said = {name: word or "" for name, word in zip(WORDS, words, strict=False)}
        events = [
            {"fault": event.fault, "text": event.text, "reaction": reaction_to(event.fault, tick.stage).words}
            for event in tick.events
        ]
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


def _known(number: int, values: Values, signals: Signals) -> _Known:
    pack = struct.Struct(f"<{len(values.numbers)}d").pack
    cells = sum(math.prod(shape) for _, _, shape in columns_of(values, signals))
    return _Known(number, pack, cells * F64.itemsize)


class Layout:
    """Column layout of a row's numbers; one shared object for all rows of a kind."""

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
        """Return a column's value in its shape."""
        begin, end, shape = self._places[name]
        return block[begin:end].reshape(shape)


@dataclass(frozen=True)
class RecordRow:
    """A row on the other side."""

    number: int
    layout: Layout
    block: Array
    words: dict[str, Any]
    """Present values of WORDS, `events` and `arm_faults`; the same object until one changes."""

    def __contains__(self, name: str) -> bool:
        return name in self.layout

    def cell(self, name: str) -> Array:
        """Return a column's value in its shape."""
        return self.layout.cell(name, self.block)


class RowDecoder:
    """The other side of RowEncoder."""

    def __init__(self) -> None:
        self._layouts: dict[int, Layout] = {}
        self._words: dict[str, Any] = {}

    def learn(self, message: bytes) -> None:
        """Store the layout of a LAYOUT message."""
        number, columns = json.loads(message[1:])
        self._layouts[number] = Layout([(topic, name, tuple(shape)) for topic, name, shape in columns])

    def row(self, message: bytes) -> RecordRow:
        """Decode a ROW message; KeyError when its layout was lost."""
        _, layout, number, words = _HEAD.unpack_from(message)
        if words:
            self._words = json.loads(message[_HEAD.size : _HEAD.size + words])
        block = np.frombuffer(message, F64, offset=_HEAD.size + words)
        return RecordRow(number, self._layouts[layout], block, self._words)
