import numpy as np
import pytest

from companion.config.controller_config import LoadedController, load_controller
from companion.simulation.scene import Scene, load_scene
from companion.simulation.simulation import Trace
from companion.studies.sweep.sweep import ERROR, Batch, Sweep, fly, joined, results
from tests.studies.sweep_rig import short_experiment

pytestmark = pytest.mark.slow

NOMINAL_RADPS = 12.0


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, LoadedController]:
    scene = load_scene(short_experiment(tmp_path_factory.mktemp("scene"))).with_bandwidth(NOMINAL_RADPS)
    return scene, load_controller("practical", scene.companion.vehicle_model(), scene.period_s)


def _batch(indices: range, seed: int = 1) -> Batch:
    return Batch(seed, "practical", "short", NOMINAL_RADPS, indices)


@pytest.mark.parametrize(("vehicles", "size"), [(1, 250), (3, 250), (8, 1), (1003, 100)])
def test_every_vehicle_is_in_one_batch(vehicles: int, size: int) -> None:
    batches = Sweep(vehicles=vehicles, seed=1, controller="practical", batch_size=size).batches()
    assert sorted(index for batch in batches for index in batch.indices) == list(range(vehicles))
    assert all(1 <= len(batch.indices) <= size for batch in batches)


def test_nominal_bandwidths_and_experiments_take_turns() -> None:
    kinds = {
        index: (batch.experiment, batch.nominal_radps)
        for batch in Sweep(vehicles=1000, seed=1, controller="practical").batches()
        for index in batch.indices
    }
    four = [("ellipse", 12.0), ("ellipse", 6.3), ("figure8", 12.0), ("figure8", 6.3)]
    assert [kinds[index] for index in range(1000)] == four * 250


def test_a_longer_sweep_has_the_full_batches_of_a_shorter_one() -> None:
    short = Sweep(vehicles=1010, seed=1, controller="practical", batch_size=100).batches()
    full = [batch for batch in short if len(batch.indices) == 100]
    assert len(full) == 8
    assert set(full) < set(Sweep(vehicles=5000, seed=1, controller="practical", batch_size=100).batches())


def test_the_same_seed_gives_the_same_numbers_to_the_last_bit(prepared: tuple[Scene, LoadedController]) -> None:
    once, again, other = (fly(_batch(range(0, 8, 2), seed), *prepared) for seed in (1, 1, 2))
    assert once.keys() == again.keys() == other.keys()
    for name, column in once.items():
        assert len(column) == 4, name
        assert np.array_equal(column, again[name]), name
    for name in (ERROR, "error_trajectory_m", "mean_error_m", "mass_kg", "flight_seed"):
        assert not np.equal(once[name], other[name]).any(), name


def test_a_vehicle_flies_alike_in_any_company(prepared: tuple[Scene, LoadedController]) -> None:
    many, few = fly(_batch(range(6)), *prepared), fly(_batch(range(2, 4)), *prepared)
    for name in ("vehicle", "mass_kg", "offset_w_m", "unseen_s"):
        assert np.array_equal(many[name][2:4], few[name]), name
    assert np.allclose(many[ERROR][2:4], few[ERROR], rtol=1e-9, atol=0.0)
    assert not many["diverged"].any()


def test_the_vehicles_fly_as_drawn(prepared: tuple[Scene, LoadedController]) -> None:
    """The farther off it begins the larger its greatest error, which is the offset itself at least."""
    rows = fly(_batch(range(12)), *prepared)
    length_m = np.linalg.norm(rows["max_error_m"], axis=-1)
    assert (length_m >= rows["offset_m"] - 0.01).all()
    assert np.corrcoef(length_m, rows["offset_m"])[0, 1] > 0.9
    assert np.allclose(np.linalg.norm(rows["offset_w_m"], axis=-1), rows["offset_m"])


def test_progress_is_told_of_each_cycle(prepared: tuple[Scene, LoadedController]) -> None:
    told: list[int] = []
    fly(_batch(range(1)), *prepared, progress=told.append)
    scene, controller = prepared
    assert told == list(range(len(scene.mission(controller.law.preview_s).time_s)))


def test_errors_by_hand() -> None:
    """One is 0.4 m off in x before the trajectory, 0.1 m in x and 0.3 m in z on it; the other flies away."""
    time_s = np.array([-2.0, -1.0, 0.0, 1.0])
    reference = np.zeros((4, 2, 3))
    position = np.zeros((4, 2, 3))
    position[:2, 0, 0], position[2:, 0, 0], position[2:, 0, 2] = 0.4, -0.1, 0.3
    position[3, 1, 1] = 5.0
    sent = np.array([[1, 1], [1, 1], [1, 0], [0, 0]], dtype=bool)
    rows = results(
        Trace(
            time_s=time_s,
            position_w_m=position,
            velocity_w_mps=position,
            reference_w_m=reference,
            reference_velocity_w_mps=reference,
            accel_w_mps2=position,
            event=sent,
            sent=sent,
        )
    )
    assert np.allclose(rows["mean_error_m"][0], [0.25, 0.0, 0.15])
    assert np.allclose(rows["error_whole_m"][0], np.sqrt(0.25**2 + 0.15**2))
    assert np.allclose(rows["error_trajectory_m"][0], np.sqrt(0.1**2 + 0.3**2))
    assert np.allclose(rows["max_error_m"][0], [0.4, 0.0, 0.3])
    assert np.allclose(rows["max_trajectory_error_m"][0], [0.1, 0.0, 0.3])
    assert rows["update_share"].tolist() == [0.5, 0.0]
    assert rows["diverged"].tolist() == [False, True]


def test_parts_join_in_the_vehicles_order() -> None:
    odd = {"vehicle": np.array([1, 3]), "mean_error_m": np.array([[1.0], [3.0]])}
    even = {"vehicle": np.array([0, 2]), "mean_error_m": np.array([[0.0], [2.0]])}
    whole = joined([odd, even])
    assert whole["vehicle"].tolist() == [0, 1, 2, 3]
    assert whole["mean_error_m"].tolist() == [[0.0], [1.0], [2.0], [3.0]]
