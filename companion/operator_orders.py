"""What an operator may order over the network, and which bytes are such an order; pure."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

MAX_BYTES = 4096
STALE_S = 5.0
"""An order is for now: one that lay in a queue for longer was meant for another moment."""
_REMEMBERED = 256
"""Ids; more than come between two deliveries of one order."""
_REASON_CHARACTERS = 200


class OrderKind(StrEnum):
    """The word in the order."""

    ABORT = "abort"
    KILL = "kill"
    HOLD = "hold"
    LAND = "land"
    RESUME = "resume"


AT_ANY_AGE = frozenset({OrderKind.ABORT, OrderKind.KILL})
"""They end a flight: clocks that disagree must not keep the operator from that. An id and, for kill, a confirmation
they need all the same."""


@dataclass(frozen=True)
class Order:
    """One that counts: well-formed, new, sent just now if that matters, and confirmed if it must be."""

    kind: OrderKind
    id: str


@dataclass(frozen=True)
class Refusal:
    """One that does not."""

    reason: str
    """A sentence without its full stop."""
    id: str = ""
    """As in the order; empty when it could not be read."""


class _Payload(BaseModel):
    """The JSON; what stands in no field is an error."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    order: OrderKind
    id: str = Field(pattern=r"^[A-Za-z0-9_.:-]{1,64}$")
    sent_s: float = Field(ge=0.0, le=1e11)
    confirm: Literal["kill"] | None = None

    @model_validator(mode="after")
    def _confirmed(self) -> "_Payload":
        if self.order is OrderKind.KILL and self.confirm is None:
            raise ValueError('kill stops the motors in the air: it needs "confirm": "kill"')
        if self.order is not OrderKind.KILL and self.confirm is not None:
            raise ValueError(f"{self.order} needs no confirmation: is kill meant?")
        return self


class Orders:
    """Tells orders from all else; remembers ids, so that one delivered twice counts once."""

    def __init__(self) -> None:
        self._taken: dict[str, None] = {}

    def take(self, payload: bytes, now_s: float) -> Order | Refusal:
        """The order in `payload`, or why there is none; `now_s` is Unix time."""
        if len(payload) > MAX_BYTES:
            return Refusal(f"{len(payload)} bytes are no order: at most {MAX_BYTES}")
        try:
            read = _Payload.model_validate_json(payload)
        except ValidationError as error:
            return Refusal(_reason(error))
        age_s = now_s - read.sent_s
        if abs(age_s) > STALE_S and read.order not in AT_ANY_AGE:
            when = f"{age_s:.1f} s ago" if age_s > 0.0 else f"{-age_s:.1f} s in the future"
            return Refusal(
                f"sent {when}, at most {STALE_S:g} s count: are both clocks set by the same server?", read.id
            )
        if read.id in self._taken:
            return Refusal("this id was taken already", read.id)
        if len(self._taken) >= _REMEMBERED:
            del self._taken[next(iter(self._taken))]
        self._taken[read.id] = None
        return Order(read.order, read.id)


def _reason(error: ValidationError) -> str:
    """The first mistake, cut short: its text may hold what the sender wrote."""
    detail = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(str(part) for part in detail["loc"])
    said = detail["msg"].removeprefix("Value error, ")
    return (f"{where}: {said}" if where else said)[:_REASON_CHARACTERS]
