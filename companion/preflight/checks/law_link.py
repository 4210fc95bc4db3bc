"""Link to a law on the ground before a flight: is it connected, alike, sighted, quick and undisturbed?"""

import math
from dataclasses import dataclass

from companion.law_link.link_status import LinkStatus
from companion.preflight.checks.check import Check
from companion.supervisor.safety_rules import SafetyRules

_OTHERS = 0o007
"""Rights of users who are neither the owner nor in the group of a file."""
_LOSSY = 0.1
"""Share of lost messages that is worth a warning: a radio in a quiet room loses less."""
_FEWEST = 10
"""Messages in a second below which no share is judged; a beat every 50 ms, the slowest allowed, gives 20."""
_CLOCKS_S = 0.02
"""Uncertainty of the clocks' offset that is worth a warning: ages are known no better."""
_COMMAND = "`companion law`"


@dataclass(frozen=True, kw_only=True)
class LawLinkFacts:
    """State of the link, and of the key's file on this computer."""

    status: LinkStatus
    version: str
    """Version of this software, which the ground's equals once it is connected."""
    where: str
    """Address and port on which this vehicle listens."""
    key_file: str
    key_mode: int | None
    """Permissions of the key's file; None when it cannot be looked at."""


def check_law_link(seen: LawLinkFacts, rules: SafetyRules) -> tuple[Check, ...]:
    """Check the link; without a ground law only what can be known then."""
    around = check_key(seen), check_foreign(seen.status)
    if not seen.status.connected:
        return check_ground_law(seen), *around
    return (
        check_ground_law(seen),
        check_heard(seen.status, rules),
        check_sight(seen.status),
        check_agrees(seen),
        check_age(seen.status, rules.command_delayed_s),
        check_round_trip(seen.status),
        check_losses(seen.status, rules.commands_lost_share),
        check_alone(seen.status),
        *around,
    )


def check_ground_law(seen: LawLinkFacts) -> Check:
    """Check that a ground law has this vehicle; a refusal names what differs, and what to do."""
    link = seen.status
    if link.connected:
        return Check("ground law", True, f"{link.law} on {link.host}, session {link.session:04x}")
    if link.refused:
        todo = f"it asks again by itself; start {_COMMAND} anew where its own file or version was changed"
        return Check("ground law", False, f"refused: {link.refused}", todo)
    if link.foreign:
        todo = "give both the same key file: nothing that arrives is sealed with this vehicle's key"
        return Check("ground law", False, "none has introduced itself with the right key", todo)
    todo = f"start {_COMMAND} on the ground; look at law.link.host and port there, and at firewalls between"
    return Check("ground law", False, f"none has asked for this vehicle on {seen.where}", todo)


def check_heard(link: LinkStatus, rules: SafetyRules) -> Check:
    """Check that the ground law was heard lately with a pose; a silence that would end a flight refuses arming."""
    heard, most_s = math.isfinite(link.silence_s), rules.command_coast_s
    says = f"{1e3 * link.silence_s:.0f} ms ago" if heard else "not yet with a pose"
    todo = f"look at {_COMMAND} on {link.host}, at its motion capture and at the network"
    says += f", at most {1e3 * most_s:.0f} wanted"
    must = link.silence_s > rules.command_silent_s
    return Check("ground law heard", link.silence_s <= most_s, says, todo, must)


def check_sight(link: LinkStatus) -> Check:
    """Check that the ground law has a fresh pose, and that its law has not failed."""
    if link.failed:
        return Check("ground law sees the vehicle", False, "its law has failed", f"look at its log on {link.host}")
    says = "it has no fresh pose" if link.blind else "it has a fresh pose"
    todo = f"look at motion capture on {link.host}: `companion mocap` there shows it without the rest"
    return Check("ground law sees the vehicle", not link.blind, says, todo)


def check_agrees(seen: LawLinkFacts) -> Check:
    """Return that both have the same version and configuration: one that differs gets no session."""
    says = f"version {seen.version} on both, and the same values of all that law and limits compute with"
    return Check("ground law agrees", seen.status.connected, says)


def check_age(link: LinkStatus, most_s: float) -> Check:
    """Check the median age of a second's messages at their arrival against the limit for flight."""
    known = math.isfinite(link.age_s)
    says = f"{1e3 * link.age_s:.1f} ms, median" if known else "not known yet: the clocks were not compared"
    todo = "look at the radio: distance, channel, other traffic, power saving; and at the load of both computers"
    return Check("commands' age", known and link.age_s <= most_s, f"{says}; at most {1e3 * most_s:.0f} wanted", todo)


def check_round_trip(link: LinkStatus) -> Check:
    """Check how well the offset of the two clocks is known: to half of the quickest round trip."""
    if not math.isfinite(link.round_trip_s):
        todo = "wait a second; if it stays so, datagrams reach the vehicle and none comes back: look at firewalls"
        return Check("link's round trip", False, "not known yet", todo)
    half_s = 0.5 * link.round_trip_s
    says = f"{1e3 * link.round_trip_s:.1f} ms; offset of the clocks known to {1e3 * half_s:.1f} ms"
    todo = "look at the network: ages of commands are measured no better than this"
    return Check("link's round trip", half_s <= _CLOCKS_S, says, todo, must=False)


def check_losses(link: LinkStatus, most_share: float) -> Check:
    """Check the messages of the last second: arming is refused where a flight would end, some losses are a warning."""
    sent = link.received + link.missing + link.late
    if sent < _FEWEST:
        says, todo = f"{sent} messages in a second, at least {_FEWEST} wanted", "look at the network, and at the ground"
        return Check("commands lost", False, says, todo)
    says = f"{link.missing} of {sent} messages in a second lost, {link.late} late"
    bad = max(link.missing, link.late)
    todo = f"look at the radio; a flight with more than {most_share:.0%} lost ends, and each loss costs accuracy"
    return Check("commands lost", bad <= _LOSSY * sent, says, todo, must=link.missing > most_share * sent)


def check_alone(link: LinkStatus) -> Check:
    """Check that no second ground law asks for this vehicle."""
    says = f"the one on {link.rival} asks, too, and is refused" if link.rival else "no other one asks for this vehicle"
    return Check("one ground law", not link.rival, says, "stop one of them", must=False)


def check_foreign(link: LinkStatus) -> Check:
    """Check for datagrams with a wrong key, of another session, or played again; all of them are dropped."""
    says = "none in the last second"
    if link.foreign:
        says = f"{link.foreign} in the last second, the newest from {link.foreign_from}: dropped"
    todo = "look who sends there: a ground law with another key, another vehicle's, or a stranger"
    return Check("foreign datagrams", not link.foreign, says, todo, must=False)


def check_key(seen: LawLinkFacts) -> Check:
    """Check that not every user of this computer may read or write the key."""
    if seen.key_mode is None:
        return Check("key file", False, f"{seen.key_file} is not there", "make one: `companion law-key FILE`")
    says = f"{seen.key_file}, mode {seen.key_mode:o}"
    return Check("key file", not seen.key_mode & _OTHERS, says, f"chmod 600 {seen.key_file}")
