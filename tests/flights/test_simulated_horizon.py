"""The whole loop, flying by an autopilot whose horizon is off, and beside a motion capture that is."""

import asyncio
import math
from functools import cache

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import ControlConfig
from companion.core.types import Array
from companion.geometry.frames import up_axis
from companion.records.row_codec import RowEncoder
from companion.records.tick_columns import frozen
from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import Phase
from tests.flights.simulated import BRISK, Flight, fly
from tests.flights.test_simulated_flights import DOWN, UP, inject, wait
from tests.mock_autopilot.bench import PERFECT

pytestmark = pytest.mark.slow

OFF_RAD = 0.04
WRONG = f"autopilot wrong (attitude off) by {OFF_RAD} rad"
HOVER_S = 5.0


@cache
def hovering(sentence: str, law: str = "etnn", corrected: bool = True, *, lands: bool = False) -> Flight:
    config = CompanionConfig(flight=BRISK, control=ControlConfig(horizon_correction=corrected))
    script = [*UP, wait(2.0), inject(sentence), wait(HOVER_S), *(DOWN if lands else [])]
    # The autopilot's horizon errs by the sentence alone: its own error is of the same size.
    return asyncio.run(fly(script, controller=law, config=config, estimator=PERFECT))


def landed() -> Flight:
    """Return the flight by a wrong horizon that several tests look at, from the ground to the ground."""
    return hovering(WRONG, lands=True)


def late_error_m(flight: Flight) -> float:
    """Mean distance from the reference in the last half of the hover."""
    held = [
        np.linalg.norm(truth - tick.reference.position_w_m)
        for tick, truth in zip(flight.ticks, flight.truths_w_m, strict=True)
        if tick.flight.phase is Phase.HOLD and tick.reference is not None
    ]
    return float(np.mean(held[-round(50 * HOVER_S) :]))


def corrections_rad(flight: Flight) -> Array:
    return np.array([(t.wire.horizon.x, t.wire.horizon.y) for t in flight.ticks if t.wire is not None])


@pytest.mark.parametrize("law", ["etnn", "pid"])
def test_a_wrong_horizon_pushes_no_law_aside(law: str) -> None:
    corrected = landed() if law == "etnn" else hovering(WRONG, law)
    bare = hovering(WRONG, law, corrected=False)
    assert late_error_m(corrected) < 0.4 * late_error_m(bare)
    assert np.abs(corrections_rad(corrected)[:, 0]).max() == pytest.approx(OFF_RAD, abs=0.004)
    assert np.abs(corrections_rad(bare)).max() == 0.0
    measured = [t.wire.horizon.off_rad for t in bare.ticks if t.wire is not None and t.flight.phase is Phase.HOLD]
    assert measured[-1] == pytest.approx(OFF_RAD, abs=0.004), "measured all the same"


def test_the_tilt_limit_holds_by_the_autopilots_horizon_too() -> None:
    flight = landed()
    most = math.cos(CompanionConfig().limits.max_tilt_rad)
    sent = [up_axis(t.wire.setpoint.q_w_flu_wxyz)[2] for t in flight.ticks if t.wire is not None]
    assert min(sent) >= most - 1e-9


def test_on_the_ground_nothing_is_corrected_and_the_rotors_idle() -> None:
    for tick in landed().ticks:
        if tick.wire is None or tick.limited is None or tick.flight.airborne:
            continue
        assert tick.wire.setpoint.thrust == tick.limited.setpoint.thrust
        if not tick.flight.touched_down:
            assert (tick.wire.horizon.x, tick.wire.horizon.y) == (0.0, 0.0)


def test_a_motion_capture_that_is_off_moves_the_vehicle_by_little_and_is_told() -> None:
    """A slipped marker plate within the cap: the correction is then the error, which the law counters as any push."""
    flight = hovering("mocap wrong (tilted) by 0.05 rad", lands=True)
    assert late_error_m(flight) < 0.05
    assert not any(event.fault is Fault.ATTITUDE_DISAGREES for tick in flight.ticks for event in tick.events)
    far = hovering("mocap wrong (tilted) by 0.2 rad")
    flying = [tick for tick in far.ticks if tick.wire is not None and tick.flight.phase is Phase.HOLD]
    assert flying[-1].wire is not None
    assert flying[-1].wire.horizon.x == 0.0, "neither is believed"


def test_the_record_has_both_setpoints() -> None:
    flight = landed()
    tick = next(tick for tick in flight.ticks[::-1] if tick.flight.phase is Phase.HOLD)
    assert tick.limited is not None
    assert tick.wire is not None
    lean = up_axis(tick.limited.setpoint.q_w_flu_wxyz) - up_axis(tick.wire.setpoint.q_w_flu_wxyz)
    assert np.linalg.norm(lean) == pytest.approx(OFF_RAD, abs=0.01)
    assert b"wire_q_w_flu_wxyz" in b"".join(RowEncoder().messages(tick, frozen(tick)))


def test_a_horizon_that_wanders_as_the_recorded_one_is_flown_better_when_it_is_corrected() -> None:
    """Takeoff and hover by an estimator with all its errors, position and height included."""
    error_m = []
    for corrected in (True, False):
        config = CompanionConfig(flight=BRISK, control=ControlConfig(horizon_correction=corrected))
        script = [*UP, wait(2.0 + HOVER_S)]
        flight = asyncio.run(fly(script, config=config, estimator={"attitude_error_source": "px4-b"}))
        error_m.append(late_error_m(flight))
    assert error_m[0] < 0.8 * error_m[1]
    assert error_m[0] < 0.012
