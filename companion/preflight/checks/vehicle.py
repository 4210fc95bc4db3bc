"""The vehicle itself: link, battery, thrust, arms, parameters, and whether it stands disarmed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from companion.config.preflight_config import Recommended
from companion.core.types import AutopilotStatus, BatteryReading
from companion.preflight.checks.check import Check

_HOVER_APART = 0.1
_PLAUSIBLE = (0.2, 0.7)
"""Below, the rotors are too large for the load; above, there is no reserve to brake and to climb."""


@dataclass(frozen=True)
class ServoFacts:
    """State of the arms' servos."""

    unread_s: float
    """Since the joint that waits longest was read; infinite when it never was."""
    fault: str
    """Fault with the joint's name; empty when there is none."""
    off_stow: str
    """The joint farthest from its stowed angle, in words; empty when the arms are stowed."""
    remarks: tuple[str, ...] = ()
    """Settings of servos and port with which they work, each a sentence with what to do."""


def check_link(status: AutopilotStatus, now_s: float, most_s: float) -> Check:
    """Check that the autopilot was heard lately."""
    age_s = now_s - status.heard_s
    known = math.isfinite(age_s) and status.connected
    says = f"heard {1e3 * age_s:.0f} ms ago, at most {1e3 * most_s:.0f} wanted" if known else "not heard"
    return Check("autopilot heard", known and age_s <= most_s, says, "look at the cable, px4.url and PX4's power")


def check_ground(status: AutopilotStatus) -> Check:
    """Check that the vehicle is landed and disarmed: this service takes over no flight that it did not start."""
    if status.in_air is None or math.isinf(status.heartbeat_s):
        todo = "wait until PX4 has started; if it stays so, look at its land detector (LNDMC_*) and at the link"
        return Check("disarmed", False, "the autopilot does not say whether it is armed, or flies", todo)
    where = "in the air" if status.in_air else "armed" if status.armed else "on the ground, disarmed"
    return Check("disarmed", not (status.in_air or status.armed), where, "land and disarm it first")


def check_alone(status: AutopilotStatus, configured: int | None) -> Check:
    """Look for other autopilots on the link: unless a number of its own is configured, the one heard first is flown."""
    others = ", ".join(status.other_autopilots)
    if not others:
        return Check("one autopilot", True, "no other one is heard on this link")
    if any(words.startswith(f"system {status.system_id} (") for words in status.other_autopilots):
        says = (
            f"system {status.system_id} would be flown, the one heard first, and another has the same number: {others}"
        )
        todo = "let each vehicle send to a port of its own, or give each PX4 its own MAV_SYS_ID and set px4.system_id"
        return Check("one autopilot", False, says, todo)
    says = f"system {status.system_id} would be flown, and heard on the same link is {others}"
    todo = (
        "set px4.system_id to this vehicle's MAV_SYS_ID, which must differ from the other's, or let each vehicle send "
        "to a port of its own"
    )
    return Check("one autopilot", configured is not None, says, todo)


def check_battery(status: AutopilotStatus, least: float) -> Check:
    """Check that the charge of the battery that carries the vehicle is known, and enough for a flight."""
    fraction, shown = status.battery_fraction, [_battery_words(one) for one in status.batteries]
    if not fraction >= 0.0:
        heard = [one.id for one in status.batteries]
        if heard and status.battery_id not in heard:
            todo = "set px4.battery_id to the battery that carries the vehicle (BAT1 is 0)"
            return Check("battery", False, f"battery {status.battery_id} is not heard, only {'; '.join(shown)}", todo)
        todo = "set up PX4's battery estimate: BAT1_N_CELLS, BAT1_CAPACITY, BAT1_V_CHARGED, BAT1_V_EMPTY"
        others = f" ({'; '.join(shown)})" if len(shown) > 1 else ""
        return Check("battery", False, f"its charge is not known{others}", todo)
    says = f"{fraction:.0%}, {status.battery_v:.1f} V, at least {least:.0%} wanted"
    if len(shown) > 1:
        says = f"{'; '.join(shown)}; at least {least:.0%} of battery {status.battery_id} wanted"
    return Check("battery", fraction >= least, says, "charge it, or take another one")


def _battery_words(one: BatteryReading) -> str:
    charge = f"{one.fraction:.0%}" if one.fraction >= 0.0 else "charge not known"
    return f"battery {one.id}: {charge}, {one.voltage_v:.1f} V"


def check_hover_thrust(hover_thrust: float, mpc_thr_hover: float) -> Check:
    """Check vehicle.hover_thrust against PX4's own MPC_THR_HOVER (NaN when unknown)."""
    low, high = _PLAUSIBLE
    says = f"vehicle.hover_thrust = {hover_thrust:g}, MPC_THR_HOVER = {mpc_thr_hover:g}"
    todo = (
        f"measure the thrust of a calm hover, which should be {low:g} to {high:g}, and write it into both: they may "
        f"differ by {_HOVER_APART:g}"
    )
    plausible = low <= hover_thrust <= high and abs(hover_thrust - mpc_thr_hover) <= _HOVER_APART
    return Check("hover thrust", plausible, says, todo)


def check_thrust_curve(thrust_curve: float, thr_mdl_fac: float) -> Check:
    """Check that the thrust curve is corrected once only: here, by PX4, or by the motor controllers."""
    says = f"vehicle.thrust_curve = {thrust_curve:g}, THR_MDL_FAC = {thr_mdl_fac:g}"
    once = math.isfinite(thr_mdl_fac) and not (thrust_curve > 0.0 and thr_mdl_fac > 0.0)
    todo = "it is corrected twice: set vehicle.thrust_curve = 0 where PX4 has THR_MDL_FAC"
    return Check("thrust curve", once, says, todo)


def check_arms(seen: ServoFacts | None, most_s: float) -> tuple[Check, ...]:
    """Check that all joints answer, without a fault, in their stowed pose; no checks for a vehicle without arms."""
    if seen is None:
        return ()
    there = seen.unread_s <= most_s and not seen.fault
    says = seen.fault or ("all joints answer" if there else f"not read for {seen.unread_s:.1f} s")
    stowed = not seen.off_stow
    return (
        Check(
            "arms present",
            there,
            says,
            "mend it, then `companion arms live clear` (`companion arms clear` where no service runs)",
        ),
        Check("arms stowed", stowed, seen.off_stow or "stowed", "fold them: `companion arms stow`"),
        *(Check("arms set up", False, *_halves(remark), must=False) for remark in seen.remarks),
    )


def _halves(remark: str) -> tuple[str, str]:
    says, _, todo = remark.rpartition(": ")
    return says, todo


def check_parameters(wanted: Mapping[str, Recommended], found: Mapping[str, float]) -> tuple[Check, ...]:
    """Return one check for each parameter; one that the autopilot did not send fails, unless it is optional.

    An autopilot that sends none at all counts as not heard, not as one without these parameters.
    """
    return tuple(_check(name, row, found.get(name, math.nan), heard=bool(found)) for name, row in wanted.items())


def _check(name: str, row: Recommended, value: float, heard: bool) -> Check:
    if math.isnan(value) and row.optional and heard:
        return Check(name, True, "this PX4 does not have it", "", row.must)
    if math.isnan(value):
        todo = f"is this PX4 older than v1.15, or the link bad? It should be {row.wanted}: {row.why}"
        return Check(name, False, "the autopilot does not tell it", todo, row.must)
    todo = f"set it to {row.set_to:g}{' and reboot PX4' if row.reboot else ''}: {row.why}"
    return Check(name, row.accepts(value), f"is {value:g}, should be {row.wanted}", todo, row.must)
