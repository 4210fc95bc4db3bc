"""The operator's orders into requests of the flight."""

from companion.flight_loop import FlightLoop
from companion.operator_orders import Order, OrderKind
from companion.ports import FlightError
from companion.supervisor.flight import Brake, Kill, Land, Request, Resume

_WANTED: dict[OrderKind, Request] = {
    OrderKind.ABORT: Land("the operator aborted"),
    OrderKind.LAND: Land(),
    OrderKind.HOLD: Brake(),
    OrderKind.RESUME: Resume(),
    OrderKind.KILL: Kill(),
}


def obey(loop: FlightLoop, order: Order) -> None:
    """Hand it to the flight loop; FlightError with the reason when it does not fit."""
    wanted = _WANTED[order.kind]
    refusal = loop.refusal(wanted)
    if refusal or not loop.ask(wanted):
        raise FlightError(f"cannot {order.kind}: {refusal}")
