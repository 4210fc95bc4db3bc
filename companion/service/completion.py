"""What follows an operator's order, for whoever gave it and waits: each returns when it is done, FlightError if not."""

from companion.core.interfaces import FlightError
from companion.service.flight_actions import FlightActions, ended_by
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import LandRequest, Phase

_STOP_S = 10.0
"""Braking takes 2 s."""
WATCHED_S = 3.0
"""So long a flight under another law is watched before it is called good: what swings shows by then."""


async def stand_still(service: FlightActions) -> None:
    """After hold: until the reference stands."""
    loop = service.loop
    end = loop.flight.legs[-1]

    def over() -> bool:
        flight = loop.flight
        return flight.phase is not Phase.HOLD or len(flight.legs) == 1 or flight.legs[-1] is not end

    still = await service.until(over, _STOP_S)
    _expect_hold(service)
    if not still or loop.flight.legs[-1] is not end:
        raise FlightError("something else is flown since" if still else f"it still brakes after {_STOP_S:.0f} s")


async def resumed(service: FlightActions, timeout_s: float) -> None:
    """After resume: until the autopilot shows OFFBOARD, and the law flies."""
    await service.until(lambda: service.phase is not Phase.RESUME, timeout_s)
    _expect_hold(service)


async def killed(service: FlightActions, timeout_s: float) -> None:
    """After kill: until the autopilot shows that the motors are off."""
    if not await service.until(lambda: not service.status.armed, timeout_s, although_failed=True):
        raise FlightError(f"the autopilot is still armed: {service.loop.action_failure or 'it does not answer'}")


def nothing_follows(service: FlightActions, why: str) -> None:
    """What no phase of the flight ends: checks before arming, and, on the ground, a motion of the arms."""
    service.loop.arming.call_off(why)
    if service.phase in {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED} and service.loop.arms is not None:
        service.loop.arms.stop(why)


async def disarmed(service: FlightActions, timeout_s: float) -> None:
    """Stop the motors of a vehicle that stands, whoever armed it; FlightError when the autopilot refuses."""
    nothing_follows(service, "the operator disarmed")
    if service.phase in {Phase.PREFLIGHT, Phase.ARMED}:
        service.loop.ask(LandRequest("the operator disarmed"))
    elif service.status.armed and service.phase is not Phase.LAND:
        await service.disarm()
    if not await service.until(lambda: not service.status.armed, timeout_s, although_failed=True):
        raise FlightError(f"the autopilot is still armed: {service.loop.action_failure or 'it does not answer'}")


async def switched(service: FlightActions) -> None:
    """Wait for WATCHED_S after another law was given the vehicle; FlightError when the flight ends meanwhile."""
    if service.loop.flight.airborne:
        await service.until(lambda: not service.loop.flight.airborne, WATCHED_S)
        if not service.loop.flight.airborne or service.loop.flight.level >= FailsafeAction.LAND:
            raise FlightError(ended_by(service.loop.flight))


def _expect_hold(service: FlightActions) -> None:
    if service.phase is not Phase.HOLD:
        raise FlightError(ended_by(service.loop.flight))
