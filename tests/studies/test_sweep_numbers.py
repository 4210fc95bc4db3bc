import math

import numpy as np
import pytest

from companion.studies.sweep.sweep import ERROR, Columns
from companion.studies.sweep.sweep_numbers import (
    PARAMETERS,
    binned,
    blames,
    correlation,
    errors_m,
    explained,
    group,
    nominals,
    of_nominal,
    ranks,
)


def _rows(error_m: list[float], diverged: list[bool] | None = None) -> Columns:
    count = len(error_m)
    return {
        "nominal_radps": np.full(count, 12.0),
        "diverged": np.array(diverged or [False] * count),
        ERROR: np.array(error_m),
        "update_share": np.linspace(0.0, 0.2, count),
    }


def test_ninety_five_of_a_hundred_have_the_percentile_or_less() -> None:
    numbers = group(_rows([float(value) for value in range(100, 0, -1)]))
    assert (numbers.error_p50_m, numbers.error_p95_m, numbers.error_max_m) == (50.0, 95.0, 100.0)
    assert (numbers.vehicles, numbers.diverged) == (100, 0)
    assert numbers.update_share == pytest.approx(0.1)


@pytest.mark.parametrize(("lost", "p95_m"), [(5, 94.0), (6, math.inf)])
def test_what_diverged_counts_as_an_infinite_error(lost: int, p95_m: float) -> None:
    flown = [float(value) for value in range(100 - lost)]
    numbers = group(_rows(flown + [math.nan] * lost, [False] * len(flown) + [True] * lost))
    assert (numbers.diverged, numbers.error_p95_m, numbers.error_max_m) == (lost, p95_m, math.inf)


def test_rows_of_a_nominal_bandwidth() -> None:
    rows = _rows([1.0, 2.0, 3.0]) | {"nominal_radps": np.array([6.3, 12.0, 6.3])}
    assert nominals(rows) == [12.0, 6.3]
    assert errors_m(of_nominal(rows, 6.3)).tolist() == [1.0, 3.0]


def test_equal_values_share_their_place() -> None:
    assert ranks(np.array([30.0, 10.0, 30.0, math.inf, 20.0])).tolist() == [3.5, 1.0, 3.5, 5.0, 2.0]
    assert ranks(np.array(["b", "a", "b"])).tolist() == [2.5, 1.0, 2.5]


def test_bins_are_about_equally_full() -> None:
    values = np.random.default_rng(1).exponential(size=205)
    bins = binned(values)
    assert sorted(np.bincount(bins)) == [20] * 5 + [21] * 5
    assert (np.diff(bins[np.argsort(values)]) >= 0).all()


def test_few_different_values_have_a_bin_each() -> None:
    assert binned(np.repeat([0.01, 0.04, 0.02], 10)).tolist() == [0] * 10 + [2] * 10 + [1] * 10


def test_correlation_by_hand() -> None:
    assert correlation(np.array([1.0, 2.0, 3.0]), np.array([1.0, 3.0, 2.0])) == pytest.approx(0.5)
    assert math.isnan(correlation(np.array([1.0, 2.0]), np.array([3.0, 3.0])))


def test_explained_by_hand() -> None:
    """Means 1 and 4 of two bins of two: within 2 * 0.5, in all 10; unbiased 1 - (1/2) / (10/3)."""
    values, bins = np.array([0.5, 1.5, 3.5, 4.5]), np.array([0, 0, 1, 1])
    assert explained(values, bins) == pytest.approx(1.0 - 0.5 / (10.0 / 3.0))
    assert math.isnan(explained(values, np.zeros(4, dtype=np.int64)))
    assert explained(np.array([1.0, 2.0, 1.0, 2.0]), bins) == 0.0


def test_what_hurts_is_found_whatever_its_form() -> None:
    """Worse on both sides of the nominal mass, worse with more delay, and nothing else."""
    rng = np.random.default_rng(4)
    rows: Columns = {name: rng.uniform(size=500) for name in PARAMETERS}
    rows["mass_kg"] = rng.permutation(np.linspace(0.0, 1.0, 500))
    rows["mocap_delay_s"] = rng.integers(2, 9, 500) * 0.005
    rows["experiment"] = np.where(rng.uniform(size=500) < 0.5, "ellipse", "figure8")
    rows |= {"diverged": np.zeros(500, dtype=bool), "update_share": np.zeros(500)}
    rows[ERROR] = 0.02 + 0.1 * (rows["mass_kg"] - 0.5) ** 2 + 0.3 * rows["mocap_delay_s"]
    found = {blame.parameter: blame for blame in blames(rows)}
    assert list(found) == list(PARAMETERS)
    assert found["mass_kg"].explained > 0.6
    assert abs(found["mass_kg"].correlation) < 0.15
    assert 0.05 < found["mocap_delay_s"].explained < 0.4
    assert found["mocap_delay_s"].correlation > 0.3
    for name in set(PARAMETERS) - {"mass_kg", "mocap_delay_s"}:
        assert found[name].explained < 0.05, name


def test_a_sweep_of_a_few_vehicles_explains_nothing() -> None:
    rows = _rows([0.1, 0.2, 0.3]) | {name: np.arange(3.0) for name in PARAMETERS}
    assert all(math.isnan(blame.explained) for blame in blames(rows))
