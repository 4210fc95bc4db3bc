"""Each recorded fact about PX4 holds for the mock, and the table in the documentation is the measured one."""

from functools import cache

import pytest

from tests.mock_autopilot.conformance import DOCUMENT, FACTS, SECTIONS, document
from tests.mock_autopilot.fact import Fact, Value
from tests.mock_autopilot.reenact.page import TITLE

pytestmark = pytest.mark.slow


@cache
def _measured(fact: Fact) -> Value:
    return fact.measure()


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.id)
def test_the_mock_does_what_px4_did(fact: Fact) -> None:
    value = _measured(fact)
    assert fact.holds(value), f"{fact.what}: PX4 {fact.px4}, mock {fact.show(value)}, accepted {fact.tolerance}"


def test_ids_are_unique_and_every_section_is_covered() -> None:
    assert len({fact.id for fact in FACTS}) == len(FACTS)
    assert {fact.section for fact in FACTS} == set(SECTIONS)


def test_the_documented_table_is_the_measured_one() -> None:
    measured = [(fact, _measured(fact)) for fact in FACTS]
    facts, title, _ = DOCUMENT.read_text(encoding="utf-8").partition(TITLE)
    assert title, "run: make conformance"
    assert facts == document(measured) + "\n", "run: make conformance"
