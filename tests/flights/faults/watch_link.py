"""Judge of a law on the ground: by what the network carried, old commands and those of strangers are never flown."""

from collections.abc import Iterator

import numpy as np

from companion.core.types import Array
from companion.flight.tick import Tick
from companion.geometry.frames import up_axis
from companion.supervisor.flight_state import COMMANDED, Phase
from tests.flights.faults.rows import CYCLE_S, RULES
from tests.flights.simulated import Flight
from tests.flights.simulated_ground import GroundWorld

LANDS_S = 0.3
"""From the last command to the order to land."""
LEVEL_RAD = 1e-3
_EARLIER_S = 2e-4
"""Resolution of the link's stamps, and of the clocks' offset over a network without jitter."""
_COMMANDED = COMMANDED - {Phase.ARMED}


def link_problems(flight: Flight) -> tuple[str, ...]:
    """Return what a law on the ground was followed in that it must not be; empty when all is well."""
    split = flight.ground
    if split is None:
        return ()
    flown = [tick for tick in flight.ticks if tick.flight.airborne and tick.flight.phase in _COMMANDED]
    return (*_too_old(flown, split), *_not_ours(flown, split))


def ages_s(ticks: list[Tick], split: GroundWorld) -> Array:
    """Return how long ago a ground law sent the newest message that had come to the vehicle, at each tick."""
    heard = [(at_s, one.sent_s) for at_s, one in split.heard if one.confirms]
    times_s = np.array([tick.time_s for tick in ticks])
    arrived_s, sent_s = np.array(heard).reshape(-1, 2).T
    newest_s = np.concatenate(([-np.inf], np.maximum.accumulate(sent_s)))
    return np.asarray(times_s - newest_s[np.searchsorted(arrived_s, times_s + 1e-9)])


def _too_old(flown: list[Tick], split: GroundWorld) -> Iterator[str]:
    ages = ages_s(flown, split)
    oldest_s = max(ages, default=0.0)
    if oldest_s > LANDS_S:
        yield f"the vehicle was still flown {oldest_s:.3f} s after the last command"
    tilts = [_tilt_rad(tick) for tick, age in zip(flown, ages, strict=True) if age > RULES.command_level_s + CYCLE_S]
    if max(tilts, default=0.0) > LEVEL_RAD:
        yield f"a tilt of {max(tilts):.3f} rad stood {RULES.command_level_s} s after the last command"


def _tilt_rad(tick: Tick) -> float:
    if tick.limited is None:
        return 0.0
    return float(np.arccos(np.clip(up_axis(tick.limited.setpoint.q_w_flu_wxyz)[2], -1.0, 1.0)))


def _not_ours(flown: list[Tick], split: GroundWorld) -> Iterator[str]:
    """Every command in use is one that a ground law of this flight has sent, or none: level."""
    cycles = [tick.flown for ground in split.all_grounds for tick in ground.ticks if tick.flown is not None]
    sent = [np.array(cycle.sent.accel_w_mps2, np.float32) for cycle in cycles if cycle.sent is not None]
    known = {(0.0, 0.0, 0.0), *(tuple(accel.tolist()) for accel in sent)}
    used = {tuple(tick.pipeline.law_output.accel_w_mps2.tolist()) for tick in flown if tick.pipeline is not None}
    strange = used - known
    if strange:
        yield f"{len(strange)} commands were flown that no ground law of this flight has sent"
