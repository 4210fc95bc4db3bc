"""A way that another vehicle has announced: meeting it is rejected in one sentence, crossing it later is said."""

import itertools
import json
import time
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.separation_config import SeparationConfig
from companion.core.types import OtherBody
from companion.flight.flight_loop import FlightLoop
from companion.protocol.commands import COMMAND
from companion.protocol.intent import Intent
from companion.protocol.telemetry import Answer, Reply
from companion.service.dispatcher import CommandDispatcher
from companion.service.traffic import Traffic, Way
from companion.supervisor.flight_state import FlightRules, TrackRequest
from companion.trajectories.reference import Hold
from tests.flights.simulated import Room
from tests.service.test_dispatcher import BRISK, SESSION, SentCommand
from tests.service.test_flight_actions import BOOTED_S, served

pytestmark = pytest.mark.slow

_IDS = itertools.count()
ORDER = SeparationConfig(order=("first", "dauam", "last"), radius_m=0.5, height_m=0.8)


class Airspace:
    """Broker of a test: what the vehicle announces, and what others have."""

    def __init__(self) -> None:
        self.others: list[Intent] = []
        self.announced: list[Intent | None] = []

    def announce(self, intent: Intent | None) -> None:
        self.announced.append(intent)

    def other(self, body: str, *knots: tuple[float, float, float, float]) -> None:
        intent = Intent(session="f" * 16, body=body, verb="track", from_s=time.time(), knots=knots)
        self.others.append(intent)


async def do(dispatcher: CommandDispatcher, verb: str, **arguments: Any) -> list[Reply]:
    sent = SentCommand()
    data = {"verb": verb, "id": f"w-{next(_IDS)}", "session": SESSION, "sent_s": 1.0, **arguments}
    dispatcher.take(COMMAND.validate_json(json.dumps(data)), sent.hear)
    await sent.end()
    return sent.replies


async def test_ways_are_compared_before_they_begin_and_announced_while_they_are_flown() -> None:
    config, air = CompanionConfig(flight=BRISK), Airspace()
    shared = config.model_copy(update={"separation": ORDER})
    traffic = Traffic(ORDER, "dauam", SESSION, air.announce, lambda: air.others, shared.flight_rules())
    room = Room(1)
    async with served(room, config) as one:
        await one.until(BOOTED_S)
        dispatcher = CommandDispatcher(config, lambda _: None, str, traffic)
        async with dispatcher.serving(one.service):
            (refused,) = await do(dispatcher, "goto", x_m=0.6, y_m=0.0, z_m=0.8)
            assert (refused.answer, air.announced) == (Answer.REFUSED, []), "on the ground for another reason"
            await one.service.ready()
            for verb in ("arm", "takeoff"):
                assert (await do(dispatcher, verb))[-1].answer is Answer.DONE

            air.other("first", (0.0, 0.6, 0.0, 0.8))
            (refused,) = await do(dispatcher, "goto", x_m=0.6, y_m=0.0, z_m=0.8)
            assert refused.answer is Answer.REFUSED
            assert refused.text.startswith("this way would come within 0.00 m of first's track at x 0.60 y 0.00 z ")
            assert refused.text.endswith(
                "and 0.5 m (or 0.8 m of height) is the least: wait until first has finished, or fly elsewhere"
            )
            assert air.announced == []

            air.others.clear()
            air.other("nobody", (0.0, 0.6, 0.0, 0.8))  # whose body is not in the order
            air.other("dauam", (0.0, 0.6, 0.0, 0.8))  # its own, by another name: found elsewhere
            air.other("last", (400.0, 0.05, -3.0, 0.8), (403.0, 0.05, 3.0, 0.8))
            accepted, done = await do(dispatcher, "goto", x_m=0.6, y_m=0.0, z_m=0.8)
            assert (accepted.answer, done.answer) == (Answer.ACCEPTED, Answer.DONE)
            assert accepted.text.startswith("it crosses last's track at x ")
            assert accepted.text.endswith(" s before it; last yields if they meet")
            began, ended = air.announced
            assert ended is None
            assert began is not None
            assert (began.body, began.verb, began.session) == ("dauam", "goto", SESSION)
            assert began.knots[-1][1:] == (0.6, 0.0, 0.8)

            show(room, OtherBody("last", (0.6, -1.5, 0.8)))
            await one.until(room.now_s() + 0.5)
            (refused,) = await do(dispatcher, "goto", x_m=0.6, y_m=-1.2, z_m=0.8)
            assert refused.answer is Answer.REFUSED
            assert refused.text.startswith(
                "another vehicle is in the way: this way leads within 0.30 m of 'last', which flies at 0.6 -1.5 0.8; "
                "at least 0.80 m are needed"
            )
            await one.service.land()


def show(room: Room, other: OtherBody) -> None:
    """Let motion capture see another vehicle from now on."""
    take = room.take
    room.take = lambda seen: take(replace(seen, others=(other,)))  # type: ignore[method-assign]


async def test_without_separation_nothing_is_compared_or_announced() -> None:
    air, nobody = Airspace(), cast(FlightLoop, None)
    air.other("first", (0.0, 0.6, 0.0, 0.8))
    traffic = Traffic(SeparationConfig(), "dauam", SESSION, air.announce, lambda: air.others, FlightRules())
    way = await traffic.way(nobody, TrackRequest(Hold(np.array([0.6, 0.0, 0.8])), 0.0))
    traffic.begin("goto", way)
    traffic.end(way)
    assert (way, air.announced) == (Way(), [])
