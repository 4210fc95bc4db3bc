"""Comparison of what came of a fault flight with what must."""

from collections.abc import Iterable
from dataclasses import dataclass

from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import Phase
from tests.flights.faults.rows import End, Row, When
from tests.flights.faults.watch import Flown, Told

_DOWN = frozenset({Phase.STOW, Phase.LAND, Phase.DISARMED})

_BY_THE_SERVICE = frozenset({Fault.ABORT, Fault.OFFBOARD_REFUSED})
"""Done by a request, not by the phase machine's own reaction."""


SOFT_MPS, PX4_MPS, BLIND_MPS, FALLING_MPS = 0.9, 0.95, 1.4, 1.7
"""Touchdown at most. We land as softly as PX4, at MPC_LAND_SPEED (0.7 m/s) and a little more: as a drop from 4 cm. PX4
alone, told to land in a flight without any fault, touched down at 0.66 to 0.91 m/s in 36 draws of its errors. With no
pose, or with wrong ones, its vertical speed is a guess: as a drop from 10 cm, which landing gear is built for. What
nobody catches in the height that is left: as a drop from 15 cm."""
_FALLS = frozenset({Fault.THRUST_SATURATED, Fault.LANDING_TOO_LONG})
"""Motors too weak for the weight that PX4 believes in; a safety line that lets go near the floor."""


@dataclass(frozen=True)
class Result:
    """One line of the report."""

    name: str
    end_state: str
    reaction_s: float | None
    """None where there was none."""
    limit_s: float
    beyond_m: float
    """Furthest outside of the fence; negative: always inside."""
    touchdown_mps: float
    drift_m: float | None
    """Horizontal way while PX4 landed without a pose; None where it did not."""
    says: str
    """The companion's reason."""
    problems: tuple[str, ...]
    """Differences from what must be; empty when there are none."""


def judged(row: Row, flown: Flown, told: Told, planned_s: float | None) -> Result:
    """`planned_s`: when the operator landed because nothing came of the fault; None when that was not needed."""
    end, reaction_s = end_of(flown, planned_s, told), reaction_of(row, flown, told, planned_s)
    drift_m = flown.drift_m if flown.blinded and end is End.HANDED_OVER else None
    return Result(
        row.name, end, reaction_s, row.limit_s, flown.beyond_m, flown.touchdown_mps, drift_m, _reason(told),
        tuple(_problems(row, end, reaction_s, flown, told)),
    )  # fmt: skip


def end_of(flown: Flown, planned_s: float | None, told: Told) -> End:
    """By the mock's truth."""
    if any(mode == "POSITION" and at_s >= (flown.begin_s or 0.0) for at_s, mode in flown.modes):
        return End.IN_THE_AIR if flown.armed else End.PILOT  # the operator takes it back and lands
    if flown.lifted_s is None:
        return End.IN_THE_AIR if flown.armed else End.NOT_STARTED
    if flown.disarmed_s is None:
        return End.TERMINATED if flown.on_ground and flown.hung else End.IN_THE_AIR
    if flown.disarmed_in_the_air:
        return End.TERMINATED if flown.on_ground else End.IN_THE_AIR
    at_last = [mode for at_s, mode in flown.modes if at_s < flown.disarmed_s][-1]
    if at_last != "OFFBOARD":
        return End.HANDED_OVER
    reacted = any(said.level > FailsafeAction.WARN for said in told.changes)
    return End.FLIES_ON if planned_s is not None and not reacted else End.LANDED


def reaction_of(row: Row, flown: Flown, told: Told, planned_s: float | None) -> float | None:
    """Return the time from the fault's begin at the mock to the reaction, s: at the mock where it shows there."""
    begin_s = flown.begin_s
    if begin_s is None or row.harmless:
        return None
    until_s = planned_s if planned_s is not None else float("inf")
    times = {
        FailsafeAction.WARN: (at_s for at_s, fault in told.events if fault is row.fault),
        FailsafeAction.DISARM: _when_down(told),
        FailsafeAction.HOLD: _when_done(row, told),
        FailsafeAction.LAND: _when_down(told),
        FailsafeAction.AUTOPILOT_LAND: (at_s for at_s, mode in flown.modes if mode != "OFFBOARD"),
        FailsafeAction.RELEASE: _last_setpoint(flown, told),
        FailsafeAction.TERMINATE: () if flown.disarmed_s is None else (flown.disarmed_s,),
    }[row.reaction]
    return next((at_s - begin_s for at_s in times if begin_s <= at_s < until_s), None)


def _when_done(row: Row, told: Told) -> Iterable[float]:
    return (said.time_s for said in told.changes if (said.level, said.cause) == (row.reaction, row.fault))


def _when_down(told: Told) -> Iterable[float]:
    return (said.time_s for said in told.changes if said.phase in _DOWN)


_TOLD_LATER_S = 0.1
"""His first setpoint leaves with his order; the tick that tells of it comes a cycle later, over the real link more."""


def _last_setpoint(flown: Flown, told: Told) -> Iterable[float]:
    """Before the operator took the vehicle back, if he did; one before the fault counts as at its begin."""
    back_s = next((said.time_s for said in told.changes if said.phase is Phase.RESUME), float("inf"))
    sent = [at_s for at_s in flown.setpoints_s if at_s < back_s - _TOLD_LATER_S]
    return (max(sent[-1], flown.begin_s or 0.0),) if sent else ()


def _reason(told: Told) -> str:
    return next((said.reason for said in reversed(told.changes) if said.reason), "")


def _problems(row: Row, end: End, reaction_s: float | None, flown: Flown, told: Told) -> Iterable[str]:
    if flown.begin_s is None:
        yield "the fault never began"
    if end is not row.ends:
        yield f"it ended {end}, not {row.ends}"
    if flown.beyond_m > 0.0:
        yield f"{flown.beyond_m:.2f} m outside of the fence"
    if not flown.on_ground:
        yield "it is not down"
    if end in {End.LANDED, End.HANDED_OVER, End.FLIES_ON}:
        yield from _hard(row, end, flown)
    if not row.harmless:
        yield from _late(row, reaction_s)
    yield from _other_reaction(row, told)


def _hard(row: Row, end: End, flown: Flown) -> Iterable[str]:
    blind = end is End.HANDED_OVER and (flown.blinded or row.fault.startswith("mocap"))
    soft_mps = PX4_MPS if end is End.HANDED_OVER else SOFT_MPS
    most_mps = FALLING_MPS if row.fault in _FALLS else BLIND_MPS if blind else soft_mps
    if flown.touchdown_mps > most_mps:
        yield f"it touched down at {flown.touchdown_mps:.2f} m/s, faster than {most_mps:.2f} m/s"


def _late(row: Row, reaction_s: float | None) -> Iterable[str]:
    if reaction_s is None:
        yield f"no reaction ({row.reaction.words})"
    elif reaction_s > row.limit_s:
        yield f"reaction after {reaction_s:.3f} s, later than {row.limit_s:.3f} s"


def _other_reaction(row: Row, told: Told) -> Iterable[str]:
    """Yield what differs from the table: its reaction must be done for this fault, and nothing as strong before it."""
    expected = FailsafeAction.WARN if row.fault in _BY_THE_SERVICE else row.reaction
    before = (
        FailsafeAction.RELEASE
        if row.when is When.HANDED_OVER and expected is FailsafeAction.WARN
        else FailsafeAction.WARN
    )
    done = [said for said in told.changes if said.level > before]
    first = next((said for said in done if said.level >= expected), None)
    if expected is FailsafeAction.WARN and first is not None:
        yield f"{first.level.words} for {first.cause or 'no fault'} ({first.reason}), although nothing is to be done"
    elif expected > FailsafeAction.WARN and first is None:
        yield f"nothing was done, not {expected.words}"
    elif first is not None and (first.level, first.cause) != (expected, row.fault):
        yield f"{first.level.words} for {first.cause or 'no fault'} ({first.reason}), not {expected.words}"
