"""Waiting for the end of an operator's request: each function returns when it is done and raises FlightError if not."""

from companion.core.interfaces import FlightError
from companion.service.flight_actions import FlightActions, ended_by
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import LandRequest, Phase

_STOP_S = 10.0
"""Time allowed to brake, which takes 2 s."""
WATCHED_S = 3.0
"""Time a flight is observed after a change of law before the change counts as done: oscillation shows by then."""


async def wait_until_hovering(service: FlightActions) -> None:
    """Wait after a hold request until the reference stands still."""
    loop = service.loop
    end = loop.flight.legs[-1]

    def over() -> bool:
        flight = loop.flight
        return flight.phase is not Phase.HOLD or len(flight.legs) == 1 or flight.legs[-1] is not end

    still = await service.until(over, _STOP_S)
    _expect_hold(service)
    if not still or loop.flight.legs[-1] is not end:
        raise FlightError(
            "another command took over while it braked" if still else f"the vehicle still brakes after {_STOP_S:.0f} s"
        )


async def wait_until_resumed(service: FlightActions, timeout_s: float) -> None:
    """Wait after a resume request until the autopilot reports OFFBOARD and the law flies."""
    await service.until(lambda: service.phase is not Phase.RESUME, timeout_s)
    _expect_hold(service)


async def wait_until_killed(service: FlightActions, timeout_s: float) -> None:
    """Wait after a kill request until the autopilot reports that the motors are off."""
    if not await service.until(lambda: not service.status.armed, timeout_s, although_failed=True):
        raise FlightError(f"the autopilot is still armed: {service.loop.action_failure or 'it does not answer'}")


def cancel_preparation(service: FlightActions, why: str) -> None:
    """Stop what no change of phase stops: the checks before arming and, on the ground, a motion of the arms."""
    service.loop.arming.call_off(why)
    if service.phase in {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED} and service.loop.arms is not None:
        service.loop.arms.stop(why)


async def disarm_and_wait(service: FlightActions, timeout_s: float) -> None:
    """Stop the motors of a vehicle on the ground, also one armed elsewhere; raise FlightError when it stays armed."""
    cancel_preparation(service, "the operator disarmed")
    if service.phase in {Phase.PREFLIGHT, Phase.ARMED}:
        service.loop.ask(LandRequest("the operator disarmed"))
    elif service.status.armed and service.phase is not Phase.LAND:
        await service.disarm()
    if not await service.until(lambda: not service.status.armed, timeout_s, although_failed=True):
        raise FlightError(f"the autopilot is still armed: {service.loop.action_failure or 'it does not answer'}")


async def watch_after_switch(service: FlightActions) -> None:
    """Wait WATCHED_S after a change of law; raise FlightError when the flight ends meanwhile."""
    if service.loop.flight.airborne:
        await service.until(lambda: not service.loop.flight.airborne, WATCHED_S)
        if not service.loop.flight.airborne or service.loop.flight.level >= FailsafeAction.LAND:
            raise FlightError(ended_by(service.loop.flight))


def _expect_hold(service: FlightActions) -> None:
    if service.phase is not Phase.HOLD:
        raise FlightError(ended_by(service.loop.flight))
