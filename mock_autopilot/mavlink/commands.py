"""Handlers for COMMAND_LONG and COMMAND_INT, and the answers to each command.

Recorded behaviour: docs/px4-conformance.md, sections a, b, e, g and j.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.mavlink.extras import protocol_version
from mock_autopilot.mavlink.messages import Message, autopilot_version
from mock_autopilot.mavlink.streams import Streams
from mock_autopilot.px4.vocabulary import Result
from mock_autopilot.world import World

Params = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True)
class Reply:
    """A command's answers on the link: messages first, then one ACK per result."""

    results: tuple[Result, ...]
    messages: tuple[Message, ...] = ()


Handler = Callable[[World, Streams, Params], Reply]


def answer(command: int, params: Params, world: World, streams: Streams) -> Reply:
    """Carry out a command and return the reply; a command that PX4 does not have is UNSUPPORTED."""
    handler = HANDLERS.get(command)
    return handler(world, streams, params) if handler else Reply((Result.UNSUPPORTED,))


def _arm(world: World, _streams: Streams, params: Params) -> Reply:
    result = world.vehicle.arm_disarm(params[0], params[1])
    return Reply(() if result is None else (result,))


def _set_mode(world: World, _streams: Streams, params: Params) -> Reply:
    """Return the commander's real result; the receiver has already sent ACCEPTED."""
    base, main, sub = (_whole(value) for value in params[:3])
    return Reply((world.vehicle.set_mode(base, main, sub),))


def _take_off(world: World, _streams: Streams, params: Params) -> Reply:
    return Reply((world.vehicle.take_off(params[6]),))


def _land(world: World, _streams: Streams, _params: Params) -> Reply:
    return Reply((world.vehicle.land(),))


def _return(world: World, _streams: Streams, _params: Params) -> Reply:
    return Reply((world.vehicle.return_home(),))


def _request_message(world: World, streams: Streams, params: Params) -> Reply:
    messages = streams.request(_whole(params[0]), world)
    return Reply((Result.ACCEPTED if messages else Result.DENIED,), tuple(messages))


def _set_interval(world: World, streams: Streams, params: Params) -> Reply:
    interval_us = params[1] if params[1] == params[1] else 0.0
    known = streams.set_interval(_whole(params[0]), interval_us, world.uptime_s)
    return Reply((Result.ACCEPTED if known else Result.FAILED,))


def _get_interval(_world: World, streams: Streams, params: Params) -> Reply:
    id_ = _whole(params[0])
    message = mavlink.MAVLink_message_interval_message(id_ % 65536, streams.interval_us(id_))
    return Reply((Result.ACCEPTED,), (message,))


def _version(world: World, _streams: Streams, _params: Params) -> Reply:
    return Reply((Result.ACCEPTED,), (autopilot_version(world),))


def _protocol(world: World, _streams: Streams, _params: Params) -> Reply:
    return Reply((Result.ACCEPTED,), (protocol_version(world),))


def _denied(_world: World, _streams: Streams, _params: Params) -> Reply:
    return Reply((Result.DENIED,))


def _whole(value: float) -> int:
    """Return the value as PX4's cast to an integer does; NaN is 0."""
    return int(value) if abs(value) < 2**31 else 0


COMMANDERS = frozenset({20, 21, 22, 176, 185, 246, 400})
"""Commands that the commander carries out and answers."""
HANDLERS: dict[int, Handler] = {
    20: _return,
    21: _land,
    22: _take_off,
    176: _set_mode,
    185: _denied,  # DO_FLIGHTTERMINATION p1=0
    246: _denied,  # REBOOT
    400: _arm,
    510: _get_interval,
    511: _set_interval,
    512: _request_message,
    519: _protocol,  # REQUEST_PROTOCOL_VERSION
    520: _version,  # REQUEST_AUTOPILOT_CAPABILITIES
}
