"""Flights by a law on the ground in which its link, the law, or somebody else in the network goes wrong."""

from dataclasses import replace

from companion.supervisor.faults import Fault
from tests.flights.faults import acts_link as link
from tests.flights.faults.rows import RULES, Act, Conditions, End, Row, When, within
from tests.flights.simulated_ground import GroundSetup, ground_config

PX4, OURS, ON = End.HANDED_OVER, End.LANDED, End.FLIES_ON
SECOND_S = 1.0
"""Shares of messages are judged over a second."""
AIR = (When.HOVER, When.TRACK, When.TAKEOFF, When.LANDING)


def split(conditions: Conditions, onboard_mocap: bool) -> Conditions:
    """Return the conditions with the law on the ground."""
    config = ground_config(conditions.config, onboard_mocap)
    return replace(conditions, config=config, more=conditions.more | {"ground": GroundSetup()})


SPLIT, SPLIT_PID = split(Conditions(), True), split(Conditions(law="pid"), True)
WITHOUT_FRAMES = split(Conditions(), False)
SILENT_S = within(RULES.command_silent_s)
BLIND_S = within(RULES.command_silent_s, RULES.coast_s)
"""The law flies on by its last pose for the time that a law on board does."""


def _silent(variant: str, make: Act | str, when: When = When.TRACK, end: End = PX4, split: Conditions = SPLIT) -> Row:
    return Row(Fault.GROUND_LAW_SILENT, variant, (make,), end, SILENT_S, when, flown_with=split)


def _harmless(fault: Fault, variant: str, make: Act | str, when: When = When.TRACK) -> Row:
    end = OURS if when is When.LANDING else ON
    return Row(fault, variant, (make,), end, 0.0, when, harmless=True, flown_with=SPLIT)


def _noted(fault: Fault, variant: str, make: Act | str, limit_s: float, when: When = When.TRACK) -> Row:
    return Row(fault, variant, (make,), ON, limit_s, when, flown_with=SPLIT)


CABLE = (
    *(_harmless(Fault.COMMAND_LATE, "the cable is out for 0.1 s", "network off for 0.1 s", when) for when in AIR),
    _noted(Fault.COMMAND_LATE, "the cable is out for 0.18 s", "network off for 0.18 s", within(RULES.command_late_s)),
    *(
        _silent(f"the cable is out for {for_s} s", f"network off for {for_s} s", when)
        for for_s in (0.3, 1, 10)
        for when in AIR
    ),
    _silent("the cable is out", "network off", When.TAKEOFF),
    _silent("the cable is out", "network off", When.GROUND, End.NOT_STARTED),
    _silent("the cable is out, no frames on the vehicle", "network off", When.TRACK, split=WITHOUT_FRAMES),
)

RADIO = (
    _harmless(Fault.COMMANDS_LOST, "30 % lost", "network intermittent"),
    _harmless(Fault.COMMANDS_LOST, "30 % lost in bursts of 0.1 s", "network intermittent (bursts of 0.1 s)"),
    Row(Fault.GROUND_LAW_SILENT, "30 % lost in bursts of 0.3 s", ("network intermittent (bursts of 0.3 s)",), PX4,
        within(RULES.command_silent_s, 2.0 * SECOND_S), When.TRACK, flown_with=SPLIT),
    Row(Fault.COMMANDS_LOST, "two thirds of the commands lost", ("network intermittent (up) by 0.67",), OURS,
        within(SECOND_S), When.TRACK, flown_with=SPLIT),
    _harmless(Fault.COMMANDS_REORDERED, "50 ms of jitter", "network delayed (jitter)"),
    _noted(Fault.COMMANDS_REORDERED, "half of them overtaken", "network wrong (reordered) by 0.5", within(SECOND_S)),
    *(Row(Fault.COMMAND_DELAYED, f"{delay_s} s late", (f"network delayed by {delay_s} s",), PX4,
        within(SECOND_S, delay_s), when, flown_with=SPLIT)
      for delay_s, when in ((0.08, When.TRACK), (0.12, When.TRACK), (0.2, When.TRACK), (0.2, When.TAKEOFF))),
    _harmless(Fault.COMMAND_DELAYED, "0.04 s late", "network delayed by 0.04 s"),
    _silent("0.4 s late", "network delayed by 0.4 s", When.TRACK),
)  # fmt: skip

LAW = (
    _silent("the law's process ends", link.law_dies, When.TRACK),
    _silent("the law's process ends", link.law_dies, When.LANDING),
    _silent("the law's process is stopped for 0.5 s", link.law_stops(0.5), When.TRACK),
    _silent("the law's process is stopped for 10 s", link.law_stops(10.0), When.HOVER),
    _silent("the law is started again within 0.1 s", link.law_restarts(0.1), When.TRACK),
    _silent("the law is started again after 2 s", link.law_restarts(2.0), When.HOVER),
    _silent("a law of another version instead of ours", link.law_of_another_version, When.GROUND, End.NOT_STARTED),
    Row(Fault.GROUND_LAW_SILENT, "frames reach the ground no more", (link.blind,), PX4, BLIND_S, When.TRACK,
        flown_with=SPLIT),
    Row(Fault.GROUND_LAW_SILENT, "frames reach the ground no more, and not the vehicle", (link.blind,), PX4, BLIND_S,
        When.TRACK, flown_with=WITHOUT_FRAMES),
    Row(Fault.MOCAP_SILENT, "frames reach neither ground nor vehicle", ("mocap off",), PX4, within(RULES.silent_s),
        When.TRACK, flown_with=SPLIT),
    _silent("the law raises", link.law_raises, split=SPLIT_PID),
    _silent("the law gives NaN", link.law_gives_nan, split=SPLIT_PID),
    *(_silent(f"the ground's clock jumps by {jump_s:g} s", link.clock_jumps(jump_s))
      for jump_s in (0.3, -0.3, 20.0, -20.0)),
)  # fmt: skip

OTHERS = (
    _noted(Fault.GROUND_LAW_TWICE, "a second ground law", link.another_law, within(SECOND_S)),
    _noted(Fault.COMMANDS_FOREIGN, "a ground law with another key", link.law_with_wrong_key, within(SECOND_S)),
    _noted(Fault.COMMANDS_FOREIGN, "an earlier flight's messages again", link.earlier_flight_again, within(0.1)),
    _noted(Fault.COMMANDS_FOREIGN, "this flight's messages again", link.this_flight_again, within(0.1)),
    _noted(Fault.COMMANDS_FOREIGN, "this flight's messages, each with a wrong bit", link.broken_copies, within(0.1)),
    _noted(Fault.COMMANDS_FOREIGN, "every message twice", "network wrong (duplicated) by 1", within(0.1)),
    _noted(Fault.COMMANDS_FOREIGN, "10,000 datagrams of noise", link.garbage, within(0.1)),
)

LINK = CABLE + RADIO + LAW + OTHERS
