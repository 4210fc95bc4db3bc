"""Ten thousand payloads that are no commands, and recorded ones sent again: none counts. Figures: docs/bus.md."""

import json
from collections import Counter

import pytest
from hypothesis import given, settings

from companion.protocol.commands import Command
from companion.protocol.intake import STALE_S, Intake, Refusal
from tests.protocol.payloads import GOOD, NOW_S, SESSION, bad_payloads, payload

MOST = 1_010
"""Times ten payloads; some are whole commands by chance."""


def test_ten_thousand_malformed_payloads_are_refused_with_a_reason() -> None:
    """Accepted payloads must be complete commands: broken bytes may be valid ones by chance."""
    counts = Counter[str]()

    @settings(max_examples=MOST)
    @given(bad_payloads())
    def none_counts(payloads: list[bytes]) -> None:
        for said in payloads:
            read = Intake(SESSION).take(said, NOW_S)
            if isinstance(read, Refusal):
                assert read.reason
                assert len(read.reason) <= 200
                counts["refused"] += 1
            else:
                assert is_whole(said, read)
                counts["whole"] += 1

    none_counts()
    print(f"malformed payloads refused: {counts['refused']}; whole commands by chance: {counts['whole']}")
    assert counts["refused"] >= 10_000
    assert counts["whole"] < counts["refused"] // 10


def is_whole(said: bytes, read: Command) -> bool:
    """Every field there stands for itself, and what the text does not say has its default."""
    fields = json.loads(said)
    as_read = json.loads(read.model_dump_json(exclude_unset=True))
    new = fields["session"] == SESSION and abs(fields["sent_s"] - NOW_S) <= STALE_S
    return new and repr(_numbers(fields)) == repr(_numbers(as_read))


def _numbers(value: object) -> object:
    """1 and 1.0 are one number in JSON; true is none."""
    if isinstance(value, dict):
        return {key: _numbers(inner) for key, inner in sorted(value.items())}
    return float(value) if type(value) is int else value


@pytest.mark.parametrize("verb", GOOD)
def test_what_was_recorded_counts_no_second_time(verb: str) -> None:
    recorded = payload(verb)
    intake, next_run = Intake(SESSION), Intake("f" * 16)
    assert not isinstance(intake.take(recorded, NOW_S), Refusal)
    for later_s in (0.0, 1.0, 100.0, 1e6):
        assert isinstance(intake.take(recorded, NOW_S + later_s), Refusal)
        assert isinstance(next_run.take(recorded, NOW_S + later_s), Refusal)
        if later_s > STALE_S:
            assert isinstance(Intake(SESSION).take(recorded, NOW_S + later_s), Refusal)
