"""The mock's vehicle carried by hand, as for the hand test before a flight."""

import numpy as np
import pytest

from mock_autopilot.physics import quaternion as quat
from tests.mock_autopilot.bench import NO_GPS, Bench


def test_it_is_carried_to_a_place_and_held_there() -> None:
    bench = Bench(NO_GPS)
    bench.vision = True
    bench.run(5.0)
    bench.world.carry((0.5, -0.2, -0.3), (0.1, 0.0, 1.5))
    bench.run(0.4)
    assert 0.1 < bench.world.truth.position_ned_m[0] < 0.4, "on its way"
    bench.run(2.0)
    assert bench.world.truth.position_ned_m == pytest.approx([0.5, -0.2, -0.3])
    assert quat.to_euler(bench.world.truth.q_ned_frd_wxyz) == pytest.approx((0.1, 0.0, 1.5))
    assert bench.world.vehicle.estimator.position_m == pytest.approx([0.5, -0.2, -0.3], abs=0.02), "vision follows"
    bench.world.carry((0.0, 0.0, 0.0))
    bench.run(1.0)
    assert bench.world.truth.position_ned_m == pytest.approx(np.zeros(3))


def test_an_armed_vehicle_is_not_carried_and_a_carried_one_is_let_go_when_armed() -> None:
    bench = Bench(NO_GPS)
    bench.vision = True
    bench.run(5.0)
    bench.world.carry((0.5, 0.0, 0.0))
    bench.run(1.0)
    bench.fly_offboard(1.0)
    assert bench.world.truth.position_ned_m[2] < -0.9, "the hand has released it"
    with pytest.raises(ValueError, match="the vehicle is armed"):
        bench.world.carry((0.0, 0.0, 0.0))


@pytest.mark.parametrize("where", [(0.0, 1.0), (0.0, 1.0, np.nan)])
def test_no_place_is_refused(where: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="it takes NORTH EAST DOWN"):
        Bench().world.carry(where)
