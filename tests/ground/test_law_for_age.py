"""The law made anew for the age of the uplink: what is not known is no verdict, and a flight is left alone."""

import math
from typing import Any

import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.core.errors import ConfigError
from companion.flight.assembly import controller_of
from companion.ground import ground_service
from companion.ground.ground_law import GroundLaw
from companion.ground.ground_service import parts_of
from companion.law_link.ground_end import GroundEnd
from companion.service.margin_process import MarginUnknownError
from tests.law_link.ends import KEY, ME

CONFIG = CompanionConfig()


@pytest.fixture
def loaded() -> LoadedController:
    return controller_of(CONFIG, "pid")


@pytest.fixture
def law(loaded: LoadedController) -> GroundLaw:
    end = GroundEnd(KEY, ME, bytes, beat_s=0.03)
    return GroundLaw(end, parts_of(CONFIG), "pid", loaded.law)


class Aged(GroundLaw):
    """A ground law whose uplink has become 20 ms old."""

    wants_law_for_s = 0.02


async def follow(law: GroundLaw, error: Exception | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the law made anew, with this result of its measurement."""

    def margin_in(*_: Any) -> None:
        if error is not None:
            raise error

    monkeypatch.setattr(ground_service, "margin_in", margin_in)
    monkeypatch.setattr(law, "__class__", Aged)
    await ground_service._Beside(law._end, law, CONFIG, False).follow_age()


async def test_a_law_with_enough_margin_is_made_for_the_new_age(
    law: GroundLaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    await follow(law, None, monkeypatch)
    assert math.isclose(law.made_for_s, 0.02)
    assert law.failure == ""


async def test_too_little_margin_is_a_failure_that_preflight_shows(
    law: GroundLaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    await follow(law, ConfigError("pid: no phase margin"), monkeypatch)
    assert law.failure == "commands are 20 ms old when they are used: pid: no phase margin"


async def test_a_measurement_that_a_busy_computer_did_not_end_is_no_verdict(
    law: GroundLaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    before_s = law.made_for_s
    await follow(law, MarginUnknownError("7 s were not enough"), monkeypatch)
    assert law.failure == ""
    assert law.made_for_s == before_s, "it is measured again"


def test_a_flight_that_began_meanwhile_goes_on(law: GroundLaw, loaded: LoadedController) -> None:
    before_s = law.made_for_s
    law._flying = True
    law.reject("too little margin", 0.03)
    law.adopt(loaded.law, 0.03)
    assert (law.failure, law.made_for_s) == ("", before_s)
