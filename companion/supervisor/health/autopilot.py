"""Health checks of the autopilot: link, mode, arming and battery. Pure."""

from math import isfinite, nan

from companion.core.types import AutopilotStatus, FlightMode
from companion.core.values import value
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD, held_since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

BOOT_BACK_S = 1.0
"""Decrease of the time since boot that is a reboot; messages out of order decrease it by less."""
REASON_WINDOW_S = 1.2
"""Age up to which a status text explains a change: HEARTBEAT's armed bit follows the text by up to a second."""
BATTERY_S = 0.5
"""Time for which the charge must be low: one bad sample is not an empty battery."""


@value
class AutopilotHealth:
    """Memory of the autopilot checks."""

    boot_s: float = nan
    """The autopilot's last finite time since boot."""
    reboot: str = ""
    """Message of a reboot while setpoints were sent; empty without one."""
    low_since_s: float = NOT_HELD
    critical_since_s: float = NOT_HELD


def check_autopilot(
    memory: AutopilotHealth, now: HealthInputs, rules: SafetyRules
) -> tuple[AutopilotHealth, list[Event]]:
    """Check the autopilot; a battery without a known charge (NaN, or negative as in MAVLink) is not checked."""
    status = now.autopilot
    charge = status.battery_fraction
    memory = AutopilotHealth(
        status.boot_s if isfinite(status.boot_s) else memory.boot_s,
        _reboot_message(memory, now),
        held_since(memory.low_since_s, 0.0 <= charge < rules.battery_low, now.time_s),
        held_since(memory.critical_since_s, 0.0 <= charge < rules.battery_critical, now.time_s),
    )
    events = _link_events(memory, now, rules)
    if now.time_s - memory.critical_since_s >= BATTERY_S:
        events.append(Event(Fault.BATTERY_CRITICAL, _charge_words(status, rules.battery_critical)))
    elif now.time_s - memory.low_since_s >= BATTERY_S:
        events.append(Event(Fault.BATTERY_LOW, _charge_words(status, rules.battery_low)))
    return memory, events


def _charge_words(status: AutopilotStatus, limit: float) -> str:
    left = f"{100.0 * status.battery_fraction:.0f} % of {status.battery_name}'s charge left"
    return f"{left}, below {100.0 * limit:.0f} %"


def _reboot_message(memory: AutopilotHealth, now: HealthInputs) -> str:
    boot_s = now.autopilot.boot_s
    if memory.boot_s - boot_s > BOOT_BACK_S:
        return f"the autopilot rebooted: its time since boot went from {memory.boot_s:.1f} s to {boot_s:.1f} s"
    return memory.reboot if now.streaming else ""


def _link_events(memory: AutopilotHealth, now: HealthInputs, rules: SafetyRules) -> list[Event]:
    status, events = now.autopilot, []
    silent_s, asked_s = now.time_s - status.heard_s, now.time_s - now.land_asked_s
    if silent_s > rules.autopilot_silent_s:
        how_long = f"for {silent_s:.2f} s" if isfinite(silent_s) else "yet"
        events.append(Event(Fault.AUTOPILOT_SILENT, f"nothing heard from the autopilot {how_long}"))
    if memory.reboot:
        events.append(Event(Fault.AUTOPILOT_REBOOTED, memory.reboot))
    if now.commanded and not status.armed:
        events.append(Event(Fault.AUTOPILOT_DISARMED, f"the autopilot disarmed without our asking{_status_texts(now)}"))
    if now.commanded and status.mode is not FlightMode.OFFBOARD:
        who = "the autopilot's own failsafe has chosen" if status.failsafe else "the autopilot shows"
        text = f"{who} mode {status.mode.value}, not offboard{_status_texts(now)}"
        events.append(Event(Fault.MODE_CHANGED, text))
    if asked_s > rules.land_refused_s:
        text = f"the autopilot still shows offboard {asked_s:.1f} s after it was told to land"
        events.append(Event(Fault.LAND_REFUSED, text))
    return events


def _status_texts(now: HealthInputs) -> str:
    """Return the autopilot's newest status texts, for the end of a message; empty without any."""
    said = now.autopilot.said_since(now.time_s - REASON_WINDOW_S)
    return f": {said}" if said else ""
