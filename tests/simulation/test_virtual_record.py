"""Virtual flights in the columns of recorded ones."""

from pathlib import Path

import numpy as np
import pytest

from companion.analysis.report.recorded_flight import Flown
from companion.analysis.summary import Columns, summarise
from companion.records.read import read_flight
from companion.simulation.metrics import score
from companion.simulation.mission import stacked
from companion.simulation.simulation import simulate
from companion.simulation.virtual_record import columns_of, one_of, until_lost
from companion.trajectories.reference import Hold
from tests.simulation.scenes import CENTRE, PUSHED, law_for, scene


def test_a_flight_of_a_batch_sums_up_to_its_own_score() -> None:
    short = scene(Hold(CENTRE, duration_s=1.0), disturbance=PUSHED)
    law = law_for(short)
    mission = stacked([short.mission(law.law.preview_s)] * 3)
    batch = simulate(short.pilot(law), short.vehicle(), mission, [1, 2, 3], keep_signals=True)
    together = score(batch)
    for number in range(3):
        columns = columns_of(one_of(batch, number))
        assert {len(values) for values in columns.values()} == {len(mission.time_s)}
        summary = summarise(columns)
        assert summary is not None
        assert summary.mean_error_m == pytest.approx(together.mean_error_m[number])
        assert summary.max_error_m == pytest.approx(together.max_error_m[number])
        assert summary.update_share == pytest.approx(together.update_share[number])
        assert np.array_equal(columns["law_y1"], batch.signals["y1"][:, number])


def test_a_report_finds_the_trajectory_of_a_virtual_flight(tmp_path: Path) -> None:
    short = scene(Hold(CENTRE, duration_s=1.0), disturbance=PUSHED)
    law = law_for(short)
    mission = stacked([short.mission(law.law.preview_s)])
    batch = simulate(short.pilot(law), short.vehicle(), mission, [1], keep_signals=True)
    np.savez(tmp_path / "flight.npz", **columns_of(one_of(batch, 0)))  # type: ignore[arg-type]
    flown = Flown(read_flight(tmp_path / "flight.npz"))
    assert flown.airborne.all()
    (trajectory,) = flown.trajectories
    assert trajectory.mask.sum() == np.sum(mission.time_s >= 0.0)


def leaving(at_row: int) -> Columns:
    """100 s of a vehicle that stands, and from one row on is 3 m away."""
    position = np.zeros((1000, 3))
    position[at_row:, 1] = 3.0
    still = np.zeros((1000, 3))
    return {
        "time_s": 0.1 * np.arange(1000.0),
        "age_s": np.zeros(1000),
        "position_w_m": position,
        "velocity_w_mps": still,
        "reference_position_w_m": still,
    }


def test_a_picture_ends_a_second_after_the_vehicle_was_lost() -> None:
    assert until_lost(leaving(300))["time_s"][-1] == pytest.approx(31.0)
    assert {len(values) for values in until_lost(leaving(300)).values()} == {311}
    assert until_lost(leaving(1000))["time_s"][-1] == pytest.approx(99.9), "it never was"
