"""Verdicts of the estimator on bad frames."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.types import MocapFrame
from companion.estimation.estimator import EstimatorState, Verdict, step
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector
from tests.estimation.flights import NOISELESS, PARAMS, Sway, followed, frame, lost, noisy


def in_flight(count: int = 50) -> EstimatorState:
    return followed(noisy(Sway(3.0), count))[-1]


def verdicts(frames: list[MocapFrame], state: EstimatorState) -> list[Verdict | None]:
    return [after.verdict for after in followed(frames, state=state)]


def after(state: EstimatorState, number: int, x_m: float = 0.0) -> MocapFrame:
    """A level frame `x_m` from where the vehicle was, slightly moved so that it is no repetition."""
    assert state.vehicle is not None
    return frame(number, state.vehicle.position_w_m + np.array([x_m, 1e-4 * number, 0.0]))


def test_the_first_frame_starts_and_the_next_are_accepted() -> None:
    assert [s.verdict for s in followed(noisy(Sway(3.0), 3))] == [Verdict.STARTED, Verdict.ACCEPTED, Verdict.ACCEPTED]


def test_a_lost_body_keeps_the_last_state_which_grows_old() -> None:
    before = in_flight()
    states = followed([lost(50), lost(51)], state=before)
    assert states[-1].vehicle is before.vehicle
    assert (states[-1].verdict, states[-1].run) == (Verdict.UNTRACKED, 2)


@pytest.mark.parametrize(
    ("rotation", "because"),
    [
        (np.diag([1.0, 1.0, -1.0]), "a mirror is no rotation"),
        (np.eye(3) * 1.1, "it stretches"),
        (np.zeros((3, 3)), "some drivers send zeros for a lost body"),
        (np.array([[1, 0.1, 0], [0, 1, 0], [0, 0, 1.0]]), "it shears"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation: np.ndarray, because: str) -> None:
    bad = replace(frame(50), rotation_w_b=rotation)
    assert verdicts([bad], in_flight()) == [Verdict.INVALID], because


def test_rotations_rounded_to_the_wires_precision_are_fine() -> None:
    taken = noisy(Sway(3.0), 20)
    rounded = [replace(t, rotation_w_b=t.rotation_w_b.astype(np.float32).astype(float)) for t in taken]
    assert followed(rounded)[-1].counts.accepted == 19


def test_a_position_outside_of_any_room_is_refused() -> None:
    assert verdicts([frame(50, (1e6, 0, 0))], in_flight()) == [Verdict.INVALID]


def test_a_frozen_system_is_told_from_a_still_vehicle() -> None:
    before = in_flight()
    frozen = [replace(after(before, 50), frame=k, stamp_s=0.01 * k) for k in range(50, 60)]
    states = followed(frozen, state=before)
    assert states[0].verdict is Verdict.ACCEPTED
    assert (states[-1].verdict, states[-1].run) == (Verdict.REPEATED, 9)
    assert states[-1].vehicle is states[0].vehicle


def test_noiseless_simulations_may_repeat() -> None:
    assert followed([frame(k) for k in range(20)], NOISELESS)[-1].counts.repeated == 0


@pytest.mark.parametrize("stamp_s", [0.49, 0.30])
def test_frames_of_the_past_change_nothing(stamp_s: float) -> None:
    before = in_flight(50)
    old = replace(after(before, 50), stamp_s=stamp_s)
    assert verdicts([old], before) == [Verdict.STALE]


def test_one_spike_is_rejected_and_the_flight_goes_on() -> None:
    flight = noisy(Sway(3.0), 60)
    flight[50] = replace(flight[50], position_w_m=flight[50].position_w_m + np.array([0.0, 0.2, 0.0]))
    states = followed(flight)
    assert states[50].verdict is Verdict.OUTLIER
    assert states[50].vehicle is states[49].vehicle
    assert states[51].verdict is Verdict.ACCEPTED
    assert states[-1].counts.outlier == 1


def test_a_flipped_attitude_is_an_outlier() -> None:
    """Markers mistaken for each other turn the body over from one frame to the next."""
    before = in_flight()
    flipped = replace(after(before, 50), rotation_w_b=np.diag([-1.0, -1.0, 1.0]))
    assert verdicts([flipped], before) == [Verdict.OUTLIER]


def test_a_jump_that_lasts_is_believed_in_the_end() -> None:
    before = in_flight()
    states = followed([after(before, 50 + k, x_m=1.0) for k in range(12)], state=before)
    assert [s.verdict for s in states] == [Verdict.OUTLIER] * 9 + [Verdict.STARTED] + [Verdict.ACCEPTED] * 2
    assert states[-1].agreeing == 0
    assert states[9].vehicle is not None
    assert states[9].velocity_std_mps == pytest.approx(1.0), "what was known of the velocity is void"


def test_jumps_that_disagree_are_never_believed() -> None:
    before = in_flight()
    states = followed([after(before, 50 + k, x_m=3.0 + k % 2) for k in range(30)], state=before)
    assert {s.verdict for s in states} == {Verdict.OUTLIER}


def test_a_heading_that_steps_is_not_waited_into_the_gate() -> None:
    """After five frames the vehicle could have turned so far; but the frames show that it was a step."""
    flight = noisy(Sway(3.0), 100)
    turn = matrix_from_quat(quat_from_rotation_vector(np.array([0.0, 0.0, 0.6])))
    flight[50:] = [replace(taken, rotation_w_b=taken.rotation_w_b @ turn) for taken in flight[50:]]
    states = followed(flight)
    assert [s.verdict for s in states[50:62]] == [Verdict.OUTLIER] * 9 + [Verdict.STARTED] + [Verdict.ACCEPTED] * 2


def test_a_place_that_steps_is_not_waited_into_the_gate_either() -> None:
    flight = noisy(Sway(3.0), 100)
    flight[50:] = [
        replace(taken, position_w_m=taken.position_w_m + np.array([0.0, 0.08, 0.0])) for taken in flight[50:]
    ]
    states = followed(flight)
    assert [s.verdict for s in states[50:60]] == [Verdict.OUTLIER] * 9 + [Verdict.STARTED]


def test_the_way_back_from_a_small_spike_is_no_outlier() -> None:
    """The true frame is within what agrees, but nearer to what was known."""
    flight = noisy(Sway(3.0), 60)
    for k in (40, 41, 42):
        flight[k] = replace(flight[k], position_w_m=flight[k].position_w_m + np.array([0.0, 0.045, 0.0]))
    states = followed(flight)
    assert [s.verdict for s in states[40:44]] == [Verdict.OUTLIER] * 3 + [Verdict.ACCEPTED]
    assert states[-1].counts.outlier == 3
    assert states[43].agreeing == 0


def test_attitudes_that_disagree_are_never_believed() -> None:
    before = in_flight()
    turns = [quat_from_rotation_vector(np.array([0.0, 0.0, 2.5 + 0.6 * (k % 2)])) for k in range(15)]
    frames = [replace(after(before, 50 + k), rotation_w_b=matrix_from_quat(turn)) for k, turn in enumerate(turns)]
    assert set(verdicts(frames, before)) == {Verdict.OUTLIER}


def test_what_physics_allows_is_no_outlier() -> None:
    """A vehicle goes from hover into 1.5 g sideways and into 8 rad/s of roll, without warning."""
    still = [frame(k, (0, 1e-5 * (k % 3), 1.0)) for k in range(50)]
    times_s = [0.01 * k for k in range(1, 25)]
    away = [
        frame(50 + k, (7.5 * t * t, 0, 1.0), quat_from_rotation_vector(np.array([min(4.0 * t, 20 * t * t), 0, 0])))
        for k, t in enumerate(times_s)
    ]
    assert followed([*still, *away])[-1].counts.outlier == 0


def test_the_gate_widens_while_the_body_is_lost() -> None:
    """Half a second of blindness: the vehicle may be half a metre from where it was headed."""
    before = in_flight()
    assert verdicts([after(before, 100, x_m=0.5)], before) == [Verdict.ACCEPTED]
    assert verdicts([after(before, 50, x_m=0.5)], before) == [Verdict.OUTLIER]


def test_a_start_in_full_flight_is_no_outlier() -> None:
    """After the first frame the velocity is unknown to 1 m/s, so 4 cm in 10 ms is within three sigma."""
    assert [s.verdict for s in followed(frame(k, (0.04 * k, 0.0, 1.0)) for k in range(4))][1:] == [Verdict.ACCEPTED] * 3


@pytest.mark.parametrize(("gap_s", "expected"), [(0.1, Verdict.ACCEPTED), (0.01, Verdict.OUTLIER)])
def test_the_attitudes_gate_widens_too(gap_s: float, expected: Verdict) -> None:
    still = followed([frame(k, (0.0, 1e-5 * (k % 3), 1.0)) for k in range(50)])[-1]
    turned = frame(90, q=quat_from_rotation_vector(np.array([0.5, 0.0, 0.0])), stamp_s=0.49 + gap_s)
    assert verdicts([turned], still) == [expected]


def test_a_long_gap_restarts_the_estimate() -> None:
    before = in_flight()
    assert verdicts([after(before, 200)], before) == [Verdict.STARTED]


@pytest.mark.parametrize(("by_s", "verdict"), [(0.12, Verdict.AHEAD), (1.0, Verdict.AHEAD), (60.0, Verdict.AHEAD),
                                               (-0.5, Verdict.STALE), (-60.0, Verdict.STALE)])  # fmt: skip
def test_a_clock_that_jumps_is_believed_after_ten_frames(by_s: float, verdict: Verdict) -> None:
    flight = noisy(Sway(3.0), 100)
    flight[50:] = [replace(taken, stamp_s=taken.stamp_s + by_s) for taken in flight[50:]]
    states = followed(flight)
    assert [s.verdict for s in states[50:61]] == [verdict] * 9 + [Verdict.STARTED, Verdict.ACCEPTED]
    for state, taken in zip(states[59:], flight[59:], strict=True):
        assert state.vehicle is not None
        assert state.vehicle.time_s == pytest.approx(taken.received_s - PARAMS.delay_s), "its age is what it was"


@pytest.mark.parametrize("by_s", [0.2, 1.5, 60.0, -0.3, -60.0])
@pytest.mark.parametrize("tracked", [True, False])
def test_one_broken_stamp_costs_one_frame(by_s: float, tracked: bool) -> None:
    flight = noisy(Sway(3.0), 100)
    broken = replace(flight[50] if tracked else lost(50), stamp_s=flight[50].stamp_s + by_s)
    states = followed([*flight[:50], broken, *flight[51:]])
    assert states[50].vehicle is states[49].vehicle
    assert {s.verdict for s in states[51:]} == {Verdict.ACCEPTED}
    assert states[-1].vehicle is not None
    assert states[-1].vehicle.time_s == pytest.approx(flight[-1].received_s - PARAMS.delay_s)


def test_frames_held_back_by_the_network_are_late_and_no_clock_that_jumped() -> None:
    """Forty come at once, then all is as before."""
    flight = noisy(Sway(3.0), 200)
    flight[100:140] = [replace(taken, received_s=flight[140].received_s) for taken in flight[100:140]]
    assert {s.verdict for s in followed(flight)[1:]} == {Verdict.ACCEPTED}


def test_a_new_measurement_with_stamps_from_zero_restarts_the_estimate() -> None:
    before = followed(noisy(Sway(3.0), 300))[-1]
    restart = replace(after(before, 1), received_s=400.0)
    (state,) = followed([restart], state=before)
    assert state.verdict is Verdict.STARTED
    assert state.vehicle is not None
    assert state.vehicle.time_s == pytest.approx(400.0 - PARAMS.delay_s)


NUMBERS = st.floats(width=64) | st.floats(-3.0, 3.0) | st.just(0.0) | st.just(1.0)
FRAMES = st.builds(
    lambda number, stamp_us, received_s, values: MocapFrame(
        frame=number,
        stamp_s=stamp_us * 1e-6,
        received_s=received_s,
        position_w_m=np.array(values[:3]),
        rotation_w_b=np.array(values[3:]).reshape(3, 3),
        residual_m=0.0,
    ),
    st.integers(0, 1000),
    st.integers(0, 10_000_000),
    st.floats(0.0, 1e6),
    st.lists(NUMBERS, min_size=12, max_size=12),
)
TRUE_FRAMES = st.builds(
    lambda number, xyz, turn: frame(number, xyz, quat_from_rotation_vector(np.array(turn))),
    st.integers(0, 300),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-3, 3)] * 3),
)


@settings(max_examples=200)
@given(st.lists(FRAMES | TRUE_FRAMES, max_size=30))
def test_nothing_makes_it_fail_or_lose_count(frames: list[MocapFrame]) -> None:
    state = EstimatorState()
    for taken in frames:
        state = step(state, taken, PARAMS)
        if state.vehicle is not None:
            values = [*state.vehicle.position_w_m, *state.vehicle.velocity_w_mps, *state.vehicle.q_w_flu_wxyz]
            assert np.isfinite([state.vehicle.time_s, *values, *state.vehicle.rate_flu_radps]).all()
            assert np.linalg.norm(state.vehicle.q_w_flu_wxyz) == pytest.approx(1.0)
    assert sum(asdict(state.counts).values()) == len(frames)
