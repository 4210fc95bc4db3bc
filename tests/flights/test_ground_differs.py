"""A ground law of another version or configuration never gets the vehicle, and the vehicle says what differs."""

import pytest

from companion import __version__
from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import ArmRequest, Phase
from tests.flights.faults.table_link import SPLIT
from tests.flights.simulated import fly
from tests.flights.simulated_ground import GroundSetup
from tests.flights.test_simulated_flights import ask, until, wait

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("setup", "difference"),
    [
        (
            GroundSetup(version="0.0.1"),
            f"the vehicle runs companion {__version__} (link protocol 1), the ground 0.0.1 (1): install the same "
            "version on both",
        ),
        (
            GroundSetup(differs={"vehicle.mass_kg": 5.0}),
            "vehicle.mass_kg is 4.85 on the vehicle and 5.0 on the ground: give both the same configuration",
        ),
    ],
)
async def test_it_is_refused_and_the_vehicle_does_not_start(setup: GroundSetup, difference: str) -> None:
    script = [wait(1.5), ask(ArmRequest()), until(Phase.DISARMED)]
    flight = await fly(script, config=SPLIT.config, ground=setup)
    assert flight.loop.flight.cause is Fault.GROUND_LAW_SILENT
    assert flight.loop.flight.reason == f"no ground law has this vehicle: refused, {difference}"
    assert flight.ground is not None
    assert flight.ground.ground.link.end.refused == difference
    assert not flight.room.bench.world.vehicle.armed
