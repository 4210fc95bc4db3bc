"""Health checks of the link to a law on the ground: silence, age, losses, foreign datagrams. Pure."""

from companion.law_link.link_status import LinkStatus
from companion.supervisor.faults import Event, Fault, Stage
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

_ENOUGH = 10
"""Messages in a second from which on a share of them is judged."""


def check_law_link(now: HealthInputs, rules: SafetyRules) -> list[Event]:
    """Check the link; no events for a law on board, or before setpoints are sent (preflight checks it then).

    While the autopilot lands, it tells whether the vehicle could be taken back.
    """
    link = now.link
    if link is None or not (now.streaming or now.stage is Stage.HANDED_OVER):
        return []
    return _silence(link, now.command_age_s, rules) + _shares(link, rules) + _strangers(link)


def _silence(link: LinkStatus, age_s: float, rules: SafetyRules) -> list[Event]:
    if age_s <= rules.command_late_s and not link.failed:
        return []
    if age_s <= rules.command_silent_s and not link.failed:
        return [Event(Fault.COMMAND_LATE, f"the ground law was last heard {age_s:.3f} s ago")]
    return [Event(Fault.GROUND_LAW_SILENT, _why_silent(link, age_s))]


def _why_silent(link: LinkStatus, age_s: float) -> str:
    if not link.connected:
        return f"no ground law has this vehicle{': refused, ' if link.refused else ''}{link.refused}"
    if link.failed:
        return f"the law on {link.host} has failed: look at its log"
    if link.blind:
        lacks = f"the ground law on {link.host} has had no fresh pose, or no plan of this vehicle, for {age_s:.2f} s"
        return f"{lacks}: look at its motion capture and at the link"
    return f"nothing from the ground law on {link.host} for {age_s:.2f} s: look at the link, and at `companion law`"


def _shares(link: LinkStatus, rules: SafetyRules) -> list[Event]:
    events, sent = [], link.received + link.missing + link.late
    if link.age_s > rules.command_delayed_s:
        text = f"commands arrive {link.age_s:.3f} s after they were sent, more than {rules.command_delayed_s:g} s"
        events.append(Event(Fault.COMMAND_DELAYED, text))
    if sent >= _ENOUGH and link.missing > rules.commands_lost_share * sent:
        events.append(Event(Fault.COMMANDS_LOST, f"{link.missing} of {sent} messages of a second did not arrive"))
    if sent >= _ENOUGH and link.late > rules.commands_late_share * sent:
        text = f"{link.late} of {sent} messages of a second arrived after a newer one"
        events.append(Event(Fault.COMMANDS_REORDERED, text))
    return events


def _strangers(link: LinkStatus) -> list[Event]:
    events = []
    if link.foreign:
        text = f"{link.foreign} datagrams in a second, the last from {link.foreign_from}, have a wrong key or session"
        events.append(Event(Fault.COMMANDS_FOREIGN, f"{text}, or were played again: dropped"))
    if link.rival:
        events.append(Event(Fault.GROUND_LAW_TWICE, f"the ground law on {link.rival} asks for this vehicle: refused"))
    return events
