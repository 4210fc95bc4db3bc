"""The error of the autopilot's horizon: as large and as slow as recorded, and the same for the same generator."""

import numpy as np
import pytest

from mock_autopilot.physics.quaternion import Array, from_rotation_vector
from mock_autopilot.px4.attitude_error import (
    RECORDED,
    SAMPLE_HZ,
    AttitudeErrorParams,
    AttitudeErrorSamples,
    AttitudeErrorSource,
    AttitudeErrorWalk,
    recorded_error_rad,
    recorded_rms_rad,
    turn_of,
    turns_of,
)

FLIGHTS: tuple[AttitudeErrorSource, ...] = ("px4-a", "px4-b", "px4-tight")


def rngs(count: int, seed: int = 1) -> list[np.random.Generator]:
    return [np.random.default_rng(part) for part in np.random.SeedSequence(seed).spawn(count)]


def drawn(params: AttitudeErrorParams, vehicles: int, count: int) -> Array:
    return AttitudeErrorSamples(params, rngs(vehicles), (vehicles,)).more(count)


def correlation(series: Array, lag: int) -> float:
    """Return the correlation of each row with the one `lag` rows later, about zero."""
    return float((series[lag:] * series[:-lag]).mean() / (series**2).mean())


@pytest.mark.parametrize(("size_rad", "time_s"), [(None, 5.0), (0.005, 1.0), (0.035, 20.0)])
def test_the_random_error_has_its_size_from_the_start_and_its_correlation_time(
    size_rad: float | None, time_s: float
) -> None:
    series = drawn(AttitudeErrorParams(size_rad=size_rad, time_s=time_s), 4000, 51)
    expected = 0.021 if size_rad is None else size_rad
    assert np.sqrt((series[0] ** 2).mean(axis=0)) == pytest.approx([expected, expected], rel=0.05)
    assert np.sqrt((series[-1] ** 2).mean(axis=0)) == pytest.approx([expected, expected], rel=0.05)
    assert correlation(series, 50) == pytest.approx(np.exp(-50 / SAMPLE_HZ / time_s), abs=0.04)
    assert np.corrcoef(series[0].T)[0, 1] == pytest.approx(0.0, abs=0.06), (
        "roll and pitch have nothing to do with each other"
    )


@pytest.mark.parametrize(
    ("source", "deviation_deg", "largest_deg", "fade_s"),
    [
        ("px4-a", (1.016, 1.107), 3.41, (3.25, 20.2)),
        ("px4-b", (1.218, 0.672), 4.75, (5.87, 13.7)),
        ("px4-tight", (0.785, 0.991), 3.61, (1.58, 15.3)),
    ],
)
def test_the_recorded_flights_are_those_that_were_recorded(
    source: AttitudeErrorSource,
    deviation_deg: tuple[float, float],
    largest_deg: float,
    fade_s: tuple[float, float],
) -> None:
    """The numbers are of the record at 100 Hz: deviation, largest error, 1/e time (roll, pitch)."""
    recorded = recorded_error_rad(source)
    assert np.degrees(recorded.std(axis=0)) == pytest.approx(deviation_deg, rel=0.02)
    assert np.degrees(np.abs(recorded).max()) == pytest.approx(largest_deg, rel=0.02)
    for axis, expected_s in enumerate(fade_s):
        centred = recorded[:, axis] - recorded[:, axis].mean()
        wide = np.correlate(centred, centred, "full")[len(centred) - 1 :]
        assert np.argmax(wide < wide[0] / np.e) / SAMPLE_HZ == pytest.approx(expected_s, rel=0.05)
    assert RECORDED.stat().st_size < 100_000


def test_the_random_default_is_of_the_recorded_flights_kind() -> None:
    """RMS of all recorded flights within a fifth; after 5 s their correlation is about 1/e or more."""
    all_rms = np.sqrt(np.mean([recorded_rms_rad(source) ** 2 for source in FLIGHTS]))
    assert AttitudeErrorParams().rms_rad == pytest.approx(all_rms, rel=0.2)


@pytest.mark.parametrize("source", FLIGHTS)
def test_a_recorded_flight_goes_on_for_ever_without_a_step_and_begins_anywhere(source: AttitudeErrorSource) -> None:
    recorded = recorded_error_rad(source)
    series = drawn(AttitudeErrorParams(source=source), 3, 3 * len(recorded))
    steps = np.abs(np.diff(series, axis=0)).max()
    assert steps == pytest.approx(np.abs(np.diff(recorded, axis=0)).max(), abs=1e-12)
    assert np.sqrt((series**2).mean()) == pytest.approx(recorded_rms_rad(source), rel=0.15)
    assert len({tuple(first) for first in series[0].tolist()}) == 3
    halved = drawn(AttitudeErrorParams(source=source, size_rad=recorded_rms_rad(source) / 2.0), 3, 10)
    assert halved == pytest.approx(series[:10] / 2.0, rel=1e-12)


@pytest.mark.parametrize("source", ["random", *FLIGHTS])
def test_a_vehicle_errs_the_same_alone_in_a_batch_and_however_far_it_is_drawn(source: AttitudeErrorSource) -> None:
    params = AttitudeErrorParams(source=source, size_rad=0.02, time_s=3.0)
    batch, walk = drawn(params, 3, 600), AttitudeErrorWalk(params, rngs(3)[2])
    walked = np.array([walk.at(k / SAMPLE_HZ) for k in range(590)])
    assert walked == pytest.approx(batch[:590, 2], abs=1e-12)
    halfway = np.array(walk.at(10.5 / SAMPLE_HZ))
    assert halfway == pytest.approx(batch[10:12, 2].mean(axis=0), rel=1e-12)


def test_the_turn_is_the_same_for_one_and_many_and_that_of_the_error() -> None:
    error_rad = np.random.default_rng(1).uniform(-0.08, 0.08, (50, 2))
    turns = turns_of(error_rad)
    assert [list(turn_of(*one)) for one in error_rad.tolist()] == turns.tolist()
    exact = from_rotation_vector(np.concatenate((error_rad, np.zeros((50, 1))), axis=-1))
    assert turns == pytest.approx(exact, abs=3e-5), "0.003 degrees at 6 degrees"


def test_without_size_there_is_no_error() -> None:
    assert not AttitudeErrorParams(size_rad=0.0).present
    assert not AttitudeErrorParams(size_rad=np.zeros(3), source="px4-a").present
    assert AttitudeErrorParams(size_rad=np.array([0.0, 0.01])).present
    assert not drawn(AttitudeErrorParams(size_rad=0.0), 2, 10).any()
