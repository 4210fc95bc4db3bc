"""The force from outside: its parts, its statistics, and a batch that gets what each vehicle would."""

import math

import numpy as np
import pytest

from mock_autopilot.physics.disturbance import BLOCK, Disturbance, Forces, Sinusoid, force_series

DT_S = 0.005
WAVES = (Sinusoid((1.4, 0.0, 0.2), 9.0), Sinusoid((0.0, 1.1, 0.0), 13.0, phase_rad=1.0))
ALL = Forces((0.4, -0.3, 0.1), WAVES, noise_n=(0.2, 0.3, 0.1), noise_time_s=0.7)


def _rngs(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(count)]


def _stepped(forces: Forces, rng: np.random.Generator, steps: int) -> np.ndarray:
    one = Disturbance(forces, rng, DT_S)
    return np.array([one.step(n * DT_S) for n in range(1, steps + 1)])


@pytest.mark.parametrize("steps", [1, 7, BLOCK, 2 * BLOCK + 100])
def test_each_vehicle_of_a_batch_gets_the_force_it_would_get_alone(steps: int) -> None:
    series = force_series(ALL, _rngs(3), DT_S, steps)
    assert series.shape == (steps, 3, 3)
    for vehicle, rng in enumerate(_rngs(3)):
        assert series[:, vehicle] == pytest.approx(_stepped(ALL, rng, steps), abs=1e-12)


def test_without_noise_it_is_the_constant_and_the_waves() -> None:
    series = force_series(Forces((0.4, -0.3, 0.1), WAVES), _rngs(1), DT_S, 400)
    at_s = 400 * DT_S
    first, second = math.sin(2 * math.pi * at_s / 9.0), math.sin(2 * math.pi * at_s / 13.0 + 1.0)
    assert series[-1, 0] == pytest.approx([0.4 + 1.4 * first, -0.3 + 1.1 * second, 0.1 + 0.2 * first])


def test_the_noise_has_its_deviation_and_correlation_time() -> None:
    noise = force_series(Forces(noise_n=(0.5, 0.5, 0.5), noise_time_s=0.2), _rngs(40), DT_S, 4000)[1000:]
    assert noise.std() == pytest.approx(0.5, rel=0.03)
    lag = round(0.2 / DT_S)
    assert (noise[:-lag] * noise[lag:]).mean() / noise.var() == pytest.approx(math.exp(-1.0), abs=0.03)
    assert abs(np.corrcoef(noise[:, 0, 0], noise[:, 1, 0])[0, 1]) < 0.3, "vehicles have noise of their own"
