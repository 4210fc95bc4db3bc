"""The health checks as a whole: silent on a healthy flight, in the table's order, never raising."""

import math
import re
from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from companion.core.types import Array, AttitudeThrust, AutopilotStatus, FlightMode, MocapFrame, VehicleState
from companion.estimation import estimator
from companion.estimation.state import EstimatorParams, EstimatorState, Verdict
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector, quat_multiply
from companion.supervisor.faults import TABLE, Event, Fault, Stage
from companion.supervisor.health.checks import Health, assess
from companion.supervisor.health_inputs import HealthInputs, MocapInputs
from companion.supervisor.safety_rules import SafetyRules
from tests.supervisor.observing import FENCE, faults, healthy, on_ground, tilted, watched, with_seen, with_status

NOT_CHECKED = {
    Fault.LIFT_OFF_UNSEEN, Fault.OFFBOARD_REFUSED, Fault.SERVICE_TWICE, Fault.LOOP_STOPPED, Fault.ABORT, Fault.KILL,
}  # fmt: skip


def test_every_number_of_the_table_is_a_limit() -> None:
    named = {name for row in TABLE for name in re.findall(r"{(\w+)}", row.sign)}
    assert len(named) > 20
    assert named <= {field.name for field in fields(SafetyRules)}


def test_a_healthy_flight_has_no_events() -> None:
    flight = [on_ground(healthy(k)) for k in range(200)] + [healthy(k) for k in range(200, 600)]
    assert not any(watched(flight))


def test_events_come_in_the_order_of_the_table_and_once_each() -> None:
    now = with_status(with_seen(healthy(0), age_s=0.07), armed=False, battery_fraction=0.2)
    now = replace(now, law_fault="no", arm_fault="the elbow", disk_free_mb=1.0, operator_age_s=9.0)
    later = replace(now, time_s=now.time_s + 0.5625)
    assert faults(watched([now, later])[-1]) == [
        Fault.MOCAP_LATE,
        Fault.LAW_FAILED,
        Fault.AUTOPILOT_SILENT,
        Fault.AUTOPILOT_DISARMED,
        Fault.BATTERY_LOW,
        Fault.ARMS,
        Fault.OPERATOR_GONE,
        Fault.DISK_FULL,
    ]


def test_what_is_remembered_of_one_flight_is_not_changed_by_the_next_cycle() -> None:
    memory = Health()
    for k in range(300):
        memory, _ = assess(memory, healthy(k), SafetyRules(), FENCE)
    before = repr(memory)
    bad = with_seen(healthy(300), age_s=1.0, stamp_s=-5.0, verdict=Verdict.STARTED)
    assert assess(memory, bad, SafetyRules(), FENCE) == assess(memory, bad, SafetyRules(), FENCE)
    assert repr(memory) == before


def test_frames_are_told_apart_by_their_arrival_whatever_their_numbers() -> None:
    """Some QTM versions give every live frame the number 1."""
    alike = [with_seen(healthy(k), frame=1) for k in range(200)]
    assert not any(watched(alike))
    jumped = with_seen(alike[100], verdict=Verdict.STARTED)
    assert faults(watched([*alike[:100], jumped])[-1]) == [Fault.MOCAP_JUMPED]


def test_a_frame_is_looked_at_once() -> None:
    first = with_seen(healthy(0), verdict=Verdict.STARTED, late=0)
    memory, _ = assess(Health(), first, SafetyRules(), FENCE)
    again = replace(first, time_s=first.time_s + 0.001)
    assert assess(memory, again, SafetyRules(), FENCE)[0].stream.frames == memory.stream.frames
    nothing = with_seen(healthy(0), verdict=None, received_s=math.nan, frame=-1, stamp_s=math.nan)
    assert assess(Health(), nothing, SafetyRules(), FENCE)[0].stream.frames.times_s == ()


def flight_of(seed: int) -> Iterator[HealthInputs]:
    """Two seconds as they are on a good day, through the real estimator.

    Noise of cameras and gyros, jitter of network and loop, up to three frames lost in a row, clocks that drift.
    """
    rng = np.random.default_rng(seed)
    state, params, lost = EstimatorState(), EstimatorParams(), 0
    sway_radps, sway_rad, phase = rng.uniform(0.5, 6.0), rng.uniform(0.0, 0.2), rng.uniform(0.0, 6.0)
    drift, zero_s, yaw_rad = rng.uniform(-5e-5, 5e-5), rng.uniform(-1e4, 1e4), rng.uniform(-3.14, 3.14)
    frame = None
    for k in range(200):
        t = 50.0 + 0.01 * k
        lost = lost + 1 if lost < 3 and k > 0 and rng.uniform() < 0.15 else 0

        def attitude(at_s: float) -> Array:
            return tilted(sway_rad * math.sin(sway_radps * at_s + phase), 0.0, yaw_rad)

        captured_s, received_s = t - 0.0125, t - 0.0025 + rng.exponential(0.0005)
        noise = quat_from_rotation_vector(rng.normal(0.0, 0.002, 3))
        place = np.array([0.5 * math.sin(0.5 * captured_s), 0.5, 1.2]) + rng.normal(0.0, 0.0003, 3)
        if not lost:
            q = quat_multiply(attitude(captured_s), noise)
            stamp_s = zero_s + captured_s * (1.0 + drift)
            frame = MocapFrame(
                frame=1000 + k,
                stamp_s=stamp_s,
                received_s=received_s,
                position_w_m=place,
                rotation_w_b=matrix_from_quat(q),
                residual_m=0.001,
            )
            state = estimator.step(state, frame, params)
        assert frame is not None
        assert state.vehicle is not None
        seen = MocapInputs(
            age_s=t - state.vehicle.time_s,
            verdict=state.verdict,
            frame=frame.frame,
            stamp_s=frame.stamp_s,
            received_s=frame.received_s,
            vehicle=state.vehicle,
        )
        theirs = quat_multiply(attitude(t - 0.02), quat_from_rotation_vector(rng.normal(0.0, 0.02, 3)))
        base = with_status(healthy(0), in_air=k > 50)
        yield replace(
            with_status(
                base,
                attitude_s=t - rng.uniform(0.0, 0.05),
                heard_s=t,
                boot_s=t,
                q_w_flu_wxyz=theirs,
                battery_fraction=math.nan,
            ),
            time_s=t,
            commanded=k > 20,  # shorter than what would be tipping over: nothing sways on the ground
            airborne=k > 50,
            mocap=seen,
            reference_w_m=state.vehicle.position_w_m + rng.normal(0.0, 0.03, 3),
            sent=AttitudeThrust(attitude(t + 0.2), np.array(0.5)),
            at_max_thrust=bool(rng.uniform() < 0.1),
            late_s=rng.exponential(0.001),
        )


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_a_good_day_has_no_events(seed: int) -> None:
    memory = Health()
    for now in flight_of(seed):
        memory, events = assess(memory, now, SafetyRules(), FENCE)
        assert not events


ANY = st.floats(width=64) | st.sampled_from([0.0, 0.3, 1.0, math.nan, math.inf, -math.inf, 1e308])
THREE, FOUR = arrays(np.float64, 3, elements=ANY), arrays(np.float64, 4, elements=ANY)
GARBAGE = st.builds(
    HealthInputs,
    time_s=ANY,
    stage=st.sampled_from(Stage),
    commanded=st.booleans(),
    streaming=st.booleans(),
    airborne=st.booleans(),
    mocap=st.builds(
        MocapInputs,
        age_s=ANY,
        verdict=st.none() | st.sampled_from(Verdict),
        frame=st.integers(-(2**63), 2**63),
        stamp_s=ANY,
        received_s=ANY,
        vehicle=st.none() | st.builds(VehicleState, ANY, THREE, THREE, FOUR, THREE),
        late=st.integers(0, 2**63),
    ),
    autopilot=st.builds(
        AutopilotStatus,
        connected=st.booleans(),
        heartbeat_s=ANY,
        armed=st.booleans(),
        mode=st.sampled_from(FlightMode),
        in_air=st.sampled_from((None, False, True)),
        battery_fraction=ANY,
        battery_v=ANY,
        q_w_flu_wxyz=FOUR,
        last_text=st.just(""),
        heard_s=ANY,
        attitude_s=ANY,
        boot_s=ANY,
    ),
    reference_w_m=st.none() | THREE,
    sent=st.none() | st.builds(AttitudeThrust, FOUR, arrays(np.float64, (), elements=ANY)),
    at_max_thrust=st.booleans(),
    law_fault=st.sampled_from(["", "no"]),
    late_s=ANY,
    landing_due_s=ANY,
    held_by_fault_since_s=ANY,
    land_asked_s=ANY,
    arm_fault=st.sampled_from(["", "no"]),
    horizon_fault=st.sampled_from(["", "no"]),
    operator_age_s=ANY,
    disk_free_mb=ANY,
)


@settings(max_examples=40)
@given(st.lists(GARBAGE, min_size=1, max_size=3))
def test_nothing_that_can_be_observed_raises(flight: list[HealthInputs]) -> None:
    for events in watched(flight, SafetyRules()):
        found = faults(events)
        assert found == [row.fault for row in TABLE if row.fault in found]
        assert not NOT_CHECKED & set(found)
        assert all(text_is_one(event) for event in events)


def text_is_one(event: Event) -> bool:
    return bool(event.text) and not event.text.endswith(".") and not event.text[0].isupper()
