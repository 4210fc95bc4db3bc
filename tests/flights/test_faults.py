"""The table of fault flights: every fault has its reaction, in time, inside the fence."""

from tests.flights.faults.table import VIRTUAL


def test_names_are_unique() -> None:
    assert len({row.name for row in VIRTUAL}) == len(VIRTUAL)
