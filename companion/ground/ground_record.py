"""Record of the law on the ground: one file a flight, with all that the law was given and made of it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from companion import __version__
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_text
from companion.core.types import NOT_HEARD
from companion.flight.tick import MoreColumns, Tick
from companion.ground.ground_tick import GroundTick
from companion.law_link.messages import UpFlags
from companion.records.record_process import RecordSink
from companion.records.table import GROUND
from companion.supervisor.flight_state import PHASES, FlightState, Phase

_LOST_S = 10.0
"""Silence of the vehicle after which its flight is over for the record."""
_LINK = {
    "/link": (
        "link_session link_epoch link_flying link_blind link_failed link_number link_acknowledged link_silence_s "
        "link_clock_offset_s link_round_trip_s link_up_age_s link_made_for_s link_arrives_s "
        "link_events link_again link_beats link_bytes link_reports link_bytes_down",
        "",
    )
}
_MIRROR = {"/link": ("mirror_thrust", "mirror_q_w_flu_wxyz")}
_NOT_HEARD_HERE = replace(NOT_HEARD, connected=False, q_w_flu_wxyz=np.full(4, np.nan))
"""The autopilot is the vehicle's; nothing of it reaches the ground."""


class GroundRecorder:
    """Observer that hands each cycle of the ground law to the process that writes; `close` it at the end."""

    def __init__(self, config: CompanionConfig, sink: RecordSink) -> None:
        self._sink = sink
        self._texts: dict[str, str] = {}
        self._session = 0
        self.flew = False
        """The law flew in at least one cycle."""
        sink.begin(
            {
                "side": GROUND,
                "config": config.model_dump(mode="json"),
                "versions": {"companion": __version__},
            }
        )

    def note_law(self, name: str) -> None:
        """Add a law's file to the record, as a replay needs it; ConfigError if there is no such law."""
        self._texts[name] = controller_text(name)
        self._sink.begin({"laws": self._texts})

    def __call__(self, tick: GroundTick) -> None:
        """Take one cycle, without waiting."""
        if tick.link.session != self._session:
            self._session = tick.link.session
            self._sink.begin({"part": f"{GROUND}-{self._session}"})
        self.flew |= tick.flying
        self._sink(tick_of(tick))

    @property
    def file(self) -> str:
        """Newest file; empty before the first."""
        return self._sink.file

    def close(self) -> None:
        """Wait until the flight's file is complete."""
        self._sink.close()


@contextmanager
def ground_recorder(config: CompanionConfig, name: str) -> Iterator[GroundRecorder | None]:
    """Record as [records] says, in files named after the vehicle; yield None where the name is empty."""
    if not name:
        yield None
        return
    recorder = GroundRecorder(config, RecordSink(config.records, name))
    try:
        yield recorder
    finally:
        recorder.close()


def tick_of(tick: GroundTick) -> Tick:
    """Return a cycle on the ground as one of a flight loop, for the record; phase and flight are as last reported."""
    flown = tick.flown
    return Tick(
        time_s=tick.time_s,
        late_s=tick.late_s,
        frame_received_s=math.nan if tick.frame is None else tick.frame.received_s,
        sent_s=math.nan if flown is None or flown.sent is None else tick.time_s,
        vehicle=tick.vehicle,
        age_s=tick.age_s,
        status=_NOT_HEARD_HERE,
        flight=FlightState(phase=_phase_of(tick), airborne=tick.flying, reason=tick.failure),
        reference=None if flown is None else flown.reference,
        pipeline=None if flown is None else flown.output,
        limited=None if flown is None else flown.output.limited,
        late_signals=tick.late_signals,
        arms=None,
        events=(),
        frame=tick.frame,
        estimate=tick.estimate,
        law=tick.law,
        more=_columns_of(tick),
    )


def _phase_of(tick: GroundTick) -> Phase:
    phase = tick.link.phase
    known = phase is not None and phase < len(PHASES) and tick.link.silence_s < _LOST_S
    return PHASES[phase] if known and phase is not None else Phase.STANDBY


def _columns_of(tick: GroundTick) -> tuple[MoreColumns, ...]:
    link, counts = tick.link, tick.link.counts
    numbers: tuple[Any, ...] = (
        link.session, tick.epoch, tick.flying, bool(tick.flags & UpFlags.BLIND), bool(tick.flags & UpFlags.FAILED),
        link.number, link.acknowledged, link.silence_s,
        link.clock_offset_s, link.round_trip_s, link.up_age_s, tick.made_for_s, tick.vehicle_s,
        counts.events, counts.again, counts.beats, counts.bytes_up, counts.reports, counts.bytes_down,
    )  # fmt: skip
    columns = MoreColumns(_LINK, numbers)
    if tick.flown is None:
        return (columns,)
    mirror = tick.flown.mirror
    return (columns, MoreColumns(_MIRROR, (mirror.thrust,), (mirror.q_w_flu_wxyz,)))
