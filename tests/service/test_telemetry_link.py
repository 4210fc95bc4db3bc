"""Telemetry of the link to a law on the ground: its numbers in every state, its news as events."""

from dataclasses import replace
from math import inf, nan

import pytest

from companion.control.remote_law import NOTHING_HEARD
from companion.flight.remote_step import LinkTick
from companion.flight.tick import Tick
from companion.law_link.link_status import NO_LINK, LinkStatus, UpCounts
from companion.law_link.link_times import LinkTimes
from companion.protocol.telemetry import Happened, Kind, State
from companion.service.telemetry import Telemetry
from tests.records.flown import flight

GOOD = replace(
    NO_LINK, connected=True, law="etnn", host="workstation (process 41)", session=0x1F, silence_s=0.012, age_s=0.0021,
    round_trip_s=0.0036, received=33, missing=2, late=1,
)  # fmt: skip


@pytest.fixture(scope="module")
def standing() -> Tick:
    return next(flight())


def at(tick: Tick, link: LinkStatus) -> Tick:
    of_link = LinkTick(
        command=NOTHING_HEARD,
        epoch=0,
        status=link,
        counts=UpCounts(),
        times=LinkTimes(),
        messages_down=0,
        bytes_down=0,
    )
    return replace(tick, link=of_link)


def told(tick: Tick, *links: LinkStatus) -> tuple[State, list[str]]:
    events: list[Happened] = []
    telemetry = Telemetry("0123456789abcdef", events.append)
    for link in links:
        telemetry(at(tick, link))
    return telemetry.state(None, 100.0), [event.text for event in events if event.kind is Kind.LOG]


def test_a_state_has_the_links_numbers(standing: Tick) -> None:
    state, _ = told(standing, GOOD)
    link = state.law_link
    assert link is not None
    assert (link.connected, link.host, link.session) == (True, "workstation (process 41)", "001f")
    assert (link.silence_s, link.age_s, link.round_trip_s) == (0.012, 0.0021, 0.0036)
    assert (link.received, link.missing, link.late, link.foreign) == (33, 2, 1, 0)
    assert State.model_validate_json(state.model_dump_json()) == state, "it can be sent"


def test_what_is_not_known_is_null(standing: Tick) -> None:
    link = told(standing, replace(GOOD, silence_s=inf, age_s=nan, round_trip_s=nan))[0].law_link
    assert link is not None
    assert (link.silence_s, link.age_s, link.round_trip_s) == (None, None, None)


def test_a_law_on_board_has_no_link(standing: Tick) -> None:
    telemetry = Telemetry("0123456789abcdef", lambda _: None)
    telemetry(standing)
    assert telemetry.state(None, 100.0).law_link is None


def test_a_ground_law_that_comes_is_told_once(standing: Tick) -> None:
    _, events = told(standing, NO_LINK, GOOD, GOOD, replace(GOOD, silence_s=0.02))
    assert events == ["the ground law etnn on workstation (process 41) has this vehicle, session 001f"]


def test_one_that_comes_again_is_told_again(standing: Tick) -> None:
    assert len(told(standing, GOOD, replace(GOOD, session=7))[1]) == 2


def test_a_refusal_is_told_with_its_reason_once(standing: Tick) -> None:
    refused = replace(NO_LINK, refused="control.rate_hz is 100.0 on the vehicle and 50.0 on the ground")
    _, events = told(standing, NO_LINK, refused, refused)
    assert events == [f"a ground law was refused: {refused.refused}"]
