"""Tables of references: when they begin, what is ahead, and how several stand side by side."""

import numpy as np
import pytest

from companion.simulation.mission import mission_of, stacked
from companion.trajectories.reference import Ellipse, LapTiming

CURVE = Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=4.0, laps=1, ramp_s=1.0))
PERIOD_S = 0.01


def test_it_holds_the_start_and_then_flies_the_curve() -> None:
    mission = mission_of(CURVE, 0.0, 1.5, PERIOD_S)
    assert len(mission.time_s) == round((1.5 + CURVE.duration_s) / PERIOD_S)
    assert mission.time_s[0] == -1.5
    assert mission.time_s[-1] == pytest.approx(CURVE.duration_s - PERIOD_S)
    assert (mission.time_s >= 0.0).sum() == round(CURVE.duration_s / PERIOD_S)
    waiting = mission.time_s < 0.0
    assert (mission.now.position_w_m[waiting] == CURVE.at(0.0).position_w_m).all()
    assert (mission.now.velocity_w_mps[waiting] == 0.0).all()
    for cycle in (170, 333, 600):
        expected, reference = CURVE.at(float(mission.time_s[cycle])), mission.now.at(cycle)
        assert reference.position_w_m.tolist() == expected.position_w_m.tolist()
        assert reference.velocity_w_mps.tolist() == expected.velocity_w_mps.tolist()
        assert reference.acceleration_w_mps2.tolist() == expected.acceleration_w_mps2.tolist()
        assert reference.yaw_rad == expected.yaw_rad


def test_what_is_ahead_is_what_comes_later() -> None:
    mission = mission_of(CURVE, 0.125, 1.0, PERIOD_S)
    for cycle in (0, 95, 400):
        expected = CURVE.at(float(mission.time_s[cycle]) + 0.125)
        assert mission.ahead.at(cycle).position_w_m.tolist() == expected.position_w_m.tolist()
        assert (
            mission.now.at(cycle).position_w_m.tolist() == CURVE.at(float(mission.time_s[cycle])).position_w_m.tolist()
        )


def test_side_by_side_each_flies_its_own_and_holds_its_end_until_the_last_is_done() -> None:
    longer = Ellipse(np.array([0.3, 0.0, 1.2]), timing=LapTiming(period_s=5.0, laps=1, ramp_s=1.0))
    short, long = mission_of(CURVE, 0.1, 1.0, PERIOD_S), mission_of(longer, 0.1, 1.0, PERIOD_S)
    both = stacked([short, long])
    assert (short.lead, both.lead) == ((), (2,))
    assert both.time_s.tolist() == long.time_s.tolist()
    end = len(short.time_s)
    for name in ("now", "ahead"):
        table, first, second = (getattr(mission, name) for mission in (both, short, long))
        for key, values in vars(table).items():
            assert np.array_equal(values[:end, 0], vars(first)[key])
            assert (values[end:, 0] == vars(first)[key][-1]).all(), f"{name}.{key} goes on after the end"
            assert np.array_equal(values[:, 1], vars(second)[key])
    assert np.abs(both.now.velocity_w_mps[end:, 0]).max() < 1e-3, "it is held at rest"
