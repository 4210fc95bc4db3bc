"""Health checks of the pose: age, frozen, jumped. Pure."""

from math import dist, hypot, inf, isfinite, isnan
from types import MappingProxyType

from companion.core.types import VehicleState
from companion.core.values import value
from companion.estimation.state import Verdict
from companion.geometry.frames import quat_conjugate, quat_multiply, rotation_vector_from_quat
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD
from companion.supervisor.health_inputs import HealthInputs, MocapInputs
from companion.supervisor.safety_rules import SafetyRules

USABLE = frozenset({Verdict.ACCEPTED, Verdict.STARTED})

_WHY_USELESS = MappingProxyType(
    {
        Verdict.UNTRACKED: (Fault.MOCAP_NAN, "frames arrive without the body"),
        Verdict.INVALID: (Fault.MOCAP_INVALID, "frames are no rotation or outside of any room"),
        Verdict.OUTLIER: (Fault.MOCAP_OUTLIERS, "frames are further off than the vehicle can have moved"),
        Verdict.REPEATED: (Fault.MOCAP_FROZEN, "frames repeat one pose to the last bit"),
        Verdict.STALE: (Fault.MOCAP_SILENT, "frames are older than one already used"),
        Verdict.AHEAD: (Fault.MOCAP_CLOCK_JUMP, "frames were captured later than they came, by their stamps"),
    }
)
_TOO_LATE = (Fault.MOCAP_SILENT, "frames arrive too late")
_NO_FRAMES = (Fault.MOCAP_SILENT, "no frames arrive")


@value
class MocapHealth:
    """Memory of the pose checks."""

    vehicle: VehicleState | None = None
    """The estimate of the newest frame's cycle."""
    repeats_from_s: float = NOT_HELD
    """Arrival of the first frame of those that repeat a pose."""
    jump: str = ""
    """Message of a pose jump in this flight; empty without one."""


def check_mocap(
    memory: MocapHealth, now: HealthInputs, rules: SafetyRules, new: bool
) -> tuple[MocapHealth, list[Event]]:
    """Check the newest pose; `new`: this cycle has a new frame. No events unless poses are `relied_on`."""
    mocap = now.mocap
    in_the_air = now.airborne or (now.autopilot.armed and now.autopilot.in_air is not False)
    if new:
        memory = _update(memory, mocap, in_the_air)
    elif not in_the_air:
        memory = MocapHealth(memory.vehicle, memory.repeats_from_s)
    if not relied_on(now):
        return memory, []
    events = _age_events(now, rules)
    repeats_s = mocap.received_s - memory.repeats_from_s
    if repeats_s >= rules.frozen_s and mocap.age_s <= rules.silent_s:
        events.append(Event(Fault.MOCAP_FROZEN, f"the pose is the same to the last bit for {repeats_s:.2f} s"))
    if memory.jump:
        events.append(Event(Fault.MOCAP_JUMPED, memory.jump))
    return memory, events


def relied_on(now: HealthInputs) -> bool:
    """Return true if we send setpoints, or the autopilot is armed and uses our poses; before that, preflight checks."""
    return now.streaming or now.autopilot.armed


def _update(memory: MocapHealth, mocap: MocapInputs, in_the_air: bool) -> MocapHealth:
    jump = memory.jump if in_the_air else ""
    if in_the_air and mocap.verdict is Verdict.STARTED:
        jump = _jump_message(memory.vehicle, mocap.vehicle)
    repeats_from_s = NOT_HELD
    if mocap.verdict is Verdict.REPEATED:
        repeats_from_s = min(memory.repeats_from_s, mocap.received_s)
    return MocapHealth(mocap.vehicle, repeats_from_s, jump)


def _jump_message(before: VehicleState | None, after: VehicleState | None) -> str:
    if before is None or after is None:
        return "motion capture began anew in the air"
    off_m = dist(before.position_w_m.tolist(), after.position_w_m.tolist())
    turn = rotation_vector_from_quat(quat_multiply(quat_conjugate(before.q_w_flu_wxyz), after.q_w_flu_wxyz))
    return f"the pose jumped by {off_m:.2f} m and {hypot(*turn.tolist()):.2f} rad, or came back so after a gap"


def _age_events(now: HealthInputs, rules: SafetyRules) -> list[Event]:
    """Return the event of the newest usable frame's age, at most one; an age of NaN counts as infinite."""
    mocap = now.mocap
    age_s = inf if isnan(mocap.age_s) else mocap.age_s
    if age_s <= rules.coast_s:
        return []
    if age_s <= rules.silent_s:
        fault = Fault.MOCAP_DEGRADED if age_s > rules.degraded_s else Fault.MOCAP_LATE
        return [Event(fault, f"the newest usable pose is {age_s:.3f} s old")]
    fault, why = _why_silent(now.time_s - mocap.received_s, age_s, mocap.verdict, rules)
    how_long = f"no usable pose for {age_s:.2f} s" if isfinite(age_s) else "no usable pose yet"
    return [Event(fault, f"{how_long}: {why}")]


def _why_silent(quiet_s: float, age_s: float, verdict: Verdict | None, rules: SafetyRules) -> tuple[Fault, str]:
    """Return fault and reason: silence, if no frame arrived for half of the time or for longer than the limit."""
    if verdict is None or not quiet_s <= min(0.5 * age_s, rules.silent_s):
        return _NO_FRAMES
    return _WHY_USELESS.get(verdict, _TOO_LATE)
