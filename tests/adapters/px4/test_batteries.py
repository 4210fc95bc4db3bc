"""Batteries by their number, and texts of PX4 that a terminal or a log could take amiss. Without a link."""

import math

import pytest

from companion.adapters.px4.telemetry import TextPieces, flight_battery, merged, reading
from companion.adapters.system.log_lines import printable
from companion.core.types import BatteryReading

SERVOS = BatteryReading(id=1, fraction=0.12, voltage_v=10.9)
FLIGHT = BatteryReading(id=0, fraction=0.9, voltage_v=15.8)


def fields(**changes: object) -> dict[str, object]:
    return {"id": 0, "voltages": [15800, *[65535] * 9], "voltages_ext": [0] * 4, "battery_remaining": 90} | changes


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, FLIGHT),
        ({"voltages": [3950] * 4 + [65535] * 6}, FLIGHT),
        ({"id": 1, "voltages": [1000] * 10, "voltages_ext": [900, 0, 0, 0], "battery_remaining": 12}, SERVOS),
        ({"voltages": [15800], "voltages_ext": None}, FLIGHT),
    ],
)
def test_a_battery_status_in_si_units(changes: dict[str, object], expected: BatteryReading) -> None:
    got = reading(fields(**changes))
    assert (got.id, got.fraction) == (expected.id, expected.fraction)
    assert got.voltage_v == pytest.approx(expected.voltage_v)


def test_what_px4_does_not_measure_is_not_known() -> None:
    got = reading(fields(voltages=[65535] * 10, battery_remaining=-1))
    assert math.isnan(got.fraction)
    assert math.isnan(got.voltage_v)


@pytest.mark.parametrize("order", [(FLIGHT, SERVOS, SERVOS), (SERVOS, FLIGHT), (FLIGHT, SERVOS, FLIGHT)])
def test_the_lowest_number_carries_the_vehicle_whoever_speaks_last(order: tuple[BatteryReading, ...]) -> None:
    known: tuple[BatteryReading, ...] = ()
    for one in order:
        known = merged(known, one)
    assert known == (FLIGHT, SERVOS)
    assert flight_battery(known, None) == FLIGHT
    assert flight_battery(known, 1) == SERVOS


def test_a_configured_battery_that_is_not_heard_is_not_replaced_by_another() -> None:
    got = flight_battery((FLIGHT, SERVOS), 2)
    assert got.id == 2
    assert math.isnan(got.fraction)


def test_control_characters_and_escape_sequences_are_shown_and_not_obeyed() -> None:
    assert printable(" \x1b[31mred\x07 \ufffd\n") == "\ufffd[31mred\ufffd \ufffd"


LONG = "x" * 50


@pytest.mark.parametrize(
    ("pieces", "texts"),
    [
        ([(0, "one"), (0, "two")], ["one", "two"]),
        ([(0, LONG)], [LONG]),
        ([(7, LONG), (7, LONG), (7, "end")], [LONG + LONG + "end"]),
        ([(7, LONG), (7, "")], [LONG]),
        ([(7, LONG), (8, "other"), (0, "third")], [LONG, "other", "third"]),
        ([(7, LONG)], []),
    ],
)
def test_a_long_text_is_put_together_from_its_pieces(pieces: list[tuple[int, str]], texts: list[str]) -> None:
    waiting = TextPieces()
    whole: list[str] = []
    for id_, piece in pieces:
        waiting, new = waiting.add(id_, piece)
        whole += new
    assert whole == texts
