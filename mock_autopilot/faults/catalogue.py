"""Catalogue of all faults that can be injected, in PX4's terms; docs/faults.md is printed from it.

The kinds are MAVLink's FAILURE_TYPE (common.xml; PX4's "System failure injection"): off, stuck, garbage, wrong, slow,
delayed, intermittent.
"""

import math
from dataclasses import dataclass
from enum import StrEnum


class Part(StrEnum):
    """The part of the system that fails."""

    MOCAP = "mocap"
    LINK = "link"
    """MAVLink between companion and autopilot."""
    AUTOPILOT = "autopilot"
    SERVOS = "servos"
    BROKER = "broker"
    """The MQTT broker. The mock runs none: it only reports when the fault begins and ends."""
    NETWORK = "network"
    """The port pairs that the mock relays, `[[impairment.relays]]`."""


class Kind(StrEnum):
    """Kinds of failure: MAVLink's FAILURE_TYPE without "ok"."""

    OFF = "off"
    STUCK = "stuck"
    GARBAGE = "garbage"
    WRONG = "wrong"
    SLOW = "slow"
    DELAYED = "delayed"
    INTERMITTENT = "intermittent"


class Phase(StrEnum):
    """Phases of a flight that the mock itself detects. Each counts from the first time it is reached."""

    ON_THE_GROUND = "on the ground"
    """Phase from the start on."""
    ARMED = "armed"
    IN_THE_AIR = "in the air"
    """Off the ground by the truth: what `at` counts from."""
    LANDING = "landing"
    """PX4 lands by itself, told to or by a failsafe."""


@dataclass(frozen=True)
class Amount:
    """The amount that a fault may have: its unit, its default and its range."""

    word: str
    """Preposition before it in a sentence: by, to, with."""
    unit: str
    usual: float
    """The default."""
    least: float
    most: float

    def text(self, value: float) -> str:
        """Return the amount as in a sentence: "by 0.5 m"."""
        return f"{self.word} {value:g}{f' {self.unit}' if self.unit else ''}"


@dataclass(frozen=True)
class Way:
    """One thing that can go wrong."""

    part: Part
    kind: Kind
    how: str
    """Variant of the kind; empty for the plain one."""
    does: str
    amount: Amount | None = None
    lasts: bool = True
    """False: it happens once, and has no "for"."""

    @property
    def words(self) -> str:
        """Return the phrase with which a sentence about this fault begins."""
        return f"{self.part} {self.kind}{f' ({self.how})' if self.how else ''}"


def _metres(usual: float) -> Amount:
    return Amount("by", "m", usual, -20.0, 20.0)


def _angle(usual: float) -> Amount:
    return Amount("by", "rad", usual, -math.pi, math.pi)


def _delay(usual: float) -> Amount:
    return Amount("by", "s", usual, 0.0, 5.0)


def _share(usual: float) -> Amount:
    return Amount("by", "", usual, 0.0, 1.0)


def _charge(usual: float) -> Amount:
    return Amount("to", "", usual, 0.0, 1.0)


TO, FROM = "to the autopilot", "from the autopilot"

_MOCAP = (
    Way(Part.MOCAP, Kind.OFF, "", "no frames; the connection stays"),
    Way(Part.MOCAP, Kind.STUCK, "", "every body stays where it is, to the last bit; frame numbers and time go on"),
    Way(Part.MOCAP, Kind.GARBAGE, "", "random places within 10 m and matrices that are no rotations"),
    Way(Part.MOCAP, Kind.GARBAGE, "packets", "data packets with a right header and broken contents: cut off, "
        "random, or with a few wrong bytes"),
    Way(Part.MOCAP, Kind.WRONG, "jump", "our body is seen this far away, along x", _metres(0.5)),
    Way(Part.MOCAP, Kind.WRONG, "drift", "our body is seen further and further away, along x",
        Amount("by", "m/s", 0.2, -5.0, 5.0)),
    Way(Part.MOCAP, Kind.WRONG, "swapped", "our body is seen where another one stands: on the floor in a corner, "
        "x = 3 m, y = 3 m, level, with the noise of a measurement"),
    Way(Part.MOCAP, Kind.WRONG, "swapped and frozen", "the same, to the last bit the same in every frame"),
    Way(Part.MOCAP, Kind.WRONG, "upside down", "our body is seen upside down (half a turn about its x) where it is"),
    Way(Part.MOCAP, Kind.WRONG, "mirrored", "y with the wrong sign, in place and attitude"),
    Way(Part.MOCAP, Kind.WRONG, "axes swapped", "x for y and y for x, in place and attitude"),
    Way(Part.MOCAP, Kind.WRONG, "turned", "our body is defined with a wrong heading (about its z)", _angle(0.6)),
    Way(Part.MOCAP, Kind.WRONG, "tilted", "our body is defined askew (about its x), as by a slipped marker plate",
        _angle(0.4)),
    Way(Part.MOCAP, Kind.WRONG, "lost", "frames without our body: all NaN"),
    Way(Part.MOCAP, Kind.WRONG, "body added", "another rigid body, box, is defined in QTM before all others; it "
        "stands in the corner"),
    Way(Part.MOCAP, Kind.WRONG, "body replaced", "our body is deleted in QTM, and box, in the corner, is defined in "
        "its place"),
    Way(Part.MOCAP, Kind.WRONG, "body deleted", "our body is deleted in QTM"),
    Way(Part.MOCAP, Kind.WRONG, "body renamed", "our body is called box in QTM"),
    Way(Part.MOCAP, Kind.WRONG, "body disabled", "our body is disabled in QTM: all NaN"),
    Way(Part.MOCAP, Kind.WRONG, "bodies reversed", "QTM's list of bodies is in the reverse order"),
    Way(Part.MOCAP, Kind.WRONG, "no bodies", "6DOF is not calculated in QTM: frames without any body"),
    Way(Part.MOCAP, Kind.WRONG, "clock jump", "time stamps are off by this",
        Amount("by", "s", 1.0, -1000.0, 1000.0)),
    Way(Part.MOCAP, Kind.WRONG, "out of order", "every second frame comes two frames late, behind its successor"),
    Way(Part.MOCAP, Kind.SLOW, "", "only this many frames a second", Amount("to", "Hz", 20.0, 0.1, 500.0)),
    Way(Part.MOCAP, Kind.DELAYED, "", "frames leave this much later; in the end the delayed ones come at once",
        _delay(0.1)),
    Way(Part.MOCAP, Kind.INTERMITTENT, "", "this share of the frames is lost, at random", _share(0.5)),
)  # fmt: skip

_LINK = tuple(
    Way(Part.LINK, kind, how, does, amount)
    for kind, does, amount in (
        (Kind.OFF, "nothing passes", None),
        (Kind.GARBAGE, "in this share of the datagrams, at random, a few bytes are wrong", _share(0.5)),
        (Kind.SLOW, "this share of the datagrams is lost, regularly, as when there is no room for more", _share(0.8)),
        (Kind.DELAYED, "everything comes this much later; in the end the delayed datagrams come at once", _delay(0.2)),
        (Kind.INTERMITTENT, "this share of the datagrams is lost, at random", _share(0.3)),
    )
    for how in ("", TO, FROM)
)

_AUTOPILOT = (
    Way(Part.AUTOPILOT, Kind.OFF, "", "no power: motors stop, nothing is sent or received; it reboots in the end"),
    Way(Part.AUTOPILOT, Kind.STUCK, "", "it hangs: nothing is sent or received, the motors keep their last signals, "
        "without control, so that it tips over"),
    Way(Part.AUTOPILOT, Kind.WRONG, "reboot", "motors stop, silent for this long, then it reboots, disarmed",
        Amount("by", "s", 3.0, 0.1, 60.0), lasts=False),
    Way(Part.AUTOPILOT, Kind.WRONG, "disarms", "it disarms, in the air, too", lasts=False),
    Way(Part.AUTOPILOT, Kind.WRONG, "pilot takes over", "a pilot with a remote control takes it, in Position mode, "
        "and holds the place", lasts=False),
    Way(Part.AUTOPILOT, Kind.WRONG, "refuses offboard", "it does not go to Offboard"),
    Way(Part.AUTOPILOT, Kind.WRONG, "refuses to land", "it refuses the command to land; its failsafes still land"),
    Way(Part.AUTOPILOT, Kind.WRONG, "ignores setpoints", "it receives them, stays in Offboard, and flies on with "
        "the last one before the fault"),
    Way(Part.AUTOPILOT, Kind.WRONG, "attitude off", "its horizon is rolled: reports it, flies by it", _angle(0.4)),
    Way(Part.AUTOPILOT, Kind.WRONG, "heading off", "its heading is wrong, whatever vision says: reports it, flies "
        "by it", _angle(0.6)),
    Way(Part.AUTOPILOT, Kind.WRONG, "battery low", "the charge is this at once, and drains on", _charge(0.2),
        lasts=False),
    Way(Part.AUTOPILOT, Kind.WRONG, "battery critical", "the charge is this at once, and drains on", _charge(0.08),
        lasts=False),
    Way(Part.AUTOPILOT, Kind.WRONG, "weak", "the motors' thrust falls to this share", _charge(0.6)),
    Way(Part.AUTOPILOT, Kind.WRONG, "motor", "a motor pulls it askew: it rolls this far from its attitude setpoint, "
        "and reports it, until its rate controller has integrated the pull away (0.75 s)", _angle(0.8)),
)  # fmt: skip

_SERVOS = (
    Way(Part.SERVOS, Kind.OFF, "", "the cable is out: nothing on the bus answers, servos keep their torque"),
    Way(Part.SERVOS, Kind.OFF, "adapter", "the adapter is unplugged: the port is gone"),
    Way(Part.SERVOS, Kind.STUCK, "", "every servo is overloaded and lets go"),
    Way(Part.SERVOS, Kind.GARBAGE, "", "a byte of every answer is wrong"),
    Way(Part.SERVOS, Kind.WRONG, "hot", "every servo is warmer than its limit allows"),
    Way(Part.SERVOS, Kind.WRONG, "voltage", "the servos' supply falls to this", Amount("to", "V", 5.5, 0.0, 20.0)),
    Way(Part.SERVOS, Kind.WRONG, "reboot", "every servo restarts: torque off, silent for half a second", lasts=False),
    Way(Part.SERVOS, Kind.DELAYED, "", "answers come this much later", Amount("by", "s", 0.05, 0.001, 5.0)),
    Way(Part.SERVOS, Kind.INTERMITTENT, "", "this share of the answers is broken, regularly",
        Amount("by", "", 0.5, 0.01, 1.0)),
)  # fmt: skip

_BROKER = (
    Way(Part.BROKER, Kind.OFF, "", "it is not there: connections end, new ones are refused"),
    Way(Part.BROKER, Kind.STUCK, "", "it hangs: connections stay, nothing passes"),
    Way(Part.BROKER, Kind.GARBAGE, "", "it sends bytes that are no MQTT"),
    Way(Part.BROKER, Kind.DELAYED, "", "messages come this much later", _delay(1.0)),
    Way(Part.BROKER, Kind.INTERMITTENT, "", "this share of the messages is lost, at random", _share(0.5)),
)

UP, DOWN = "up", "down"

_NETWORK = (
    *(
        Way(Part.NETWORK, kind, how, does, amount)
        for kind, does, amount in (
            (Kind.OFF, "nothing passes, as with the cable pulled", None),
            (Kind.DELAYED, "everything comes this much later", _delay(0.05)),
            (Kind.INTERMITTENT, "this share of the datagrams is lost, at random", _share(0.3)),
        )
        for how in ("", UP, DOWN)
    ),
    Way(Part.NETWORK, Kind.INTERMITTENT, "bursts of 0.1 s", "for this share of the time nothing passes, 0.1 s at a "
        "time, at random", _share(0.3)),
    Way(Part.NETWORK, Kind.INTERMITTENT, "bursts of 0.3 s", "the same, 0.3 s at a time", _share(0.3)),
    Way(Part.NETWORK, Kind.DELAYED, "jitter", "every datagram comes later by another time, at random, up to this; "
        "it may be overtaken", _delay(0.05)),
    Way(Part.NETWORK, Kind.WRONG, "reordered", "this share of the datagrams comes behind its successor",
        Amount("by", "", 0.2, 0.0, 0.5)),
    Way(Part.NETWORK, Kind.WRONG, "duplicated", "this share of the datagrams comes twice", _share(0.2)),
    Way(Part.NETWORK, Kind.SLOW, "", "only so many bytes pass in a second; what would wait longer than 0.2 s is lost",
        Amount("to", "kB/s", 2.0, 0.1, 1000.0)),
)  # fmt: skip

WAYS: tuple[Way, ...] = (*_MOCAP, *_LINK, *_AUTOPILOT, *_SERVOS, *_BROKER, *_NETWORK)


def ways_of(part: Part, kind: Kind) -> list[Way]:
    """Return all variants of a kind; empty when this part cannot fail in that way."""
    return [way for way in WAYS if way.part is part and way.kind is kind]
