"""The peers' laws against their equations by hand, and the trigger that they share."""

import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.controller_config import PEERS, load_controller, peer_law, read_peer
from companion.control.controller import ControlInput, VehicleModel
from companion.control.lag_models import exponential, first_order, second_order
from companion.control.law_check import LawFile, check_law
from companion.control.peers.geometric_pid import GeometricPid, GeometricPidGains
from companion.control.peers.indi import Indi, IndiGains, LowPass
from companion.control.peers.l1_adaptive import L1Adaptive, L1Gains
from companion.control.peers.linear_mpc import BLOCK_S, MOVES, LinearMpc, MpcGains, MpcMemory
from companion.control.peers.outer_loop import FeedbackLaw, PeerLaw, send_on_change
from companion.core.interfaces import ConfigError
from companion.core.types import Array, Reference
from companion.geometry.attitude import ThrustModel, setpoint_of_accel
from tests.control.test_whole_laws import at, inputs, leaves

VEHICLE = VehicleModel()
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
KP, KD = (4.0, 5.0, 6.0), (3.0, 2.5, 2.0)
FEEDBACK = {"kp_per_s2": list(KP), "kd_per_s": list(KD), "predict": False, "send_from_mps2": 0.0}
BARE: list[PeerLaw[Any]] = [
    GeometricPid(GeometricPidGains.model_validate(FEEDBACK), VEHICLE, 0.01),
    Indi(IndiGains.model_validate(FEEDBACK), VEHICLE, 0.01),
    L1Adaptive(L1Gains.model_validate(FEEDBACK), VEHICLE, 0.01),
]
SHIPPED: list[PeerLaw[Any]] = [peer_law(read_peer(name), VEHICLE, 0.01) for name in PEERS]
Numbers = Array | Sequence[float]
VECTOR = st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3)


def seen(
    position: Numbers,
    velocity: Numbers,
    accel_ref: Numbers = (0.0, 0.0, 0.0),
    sent: Numbers = (0.0, 0.0, 0.0),
) -> ControlInput:
    zero = np.zeros(3)
    return ControlInput(
        position_w_m=np.array(position),
        velocity_w_mps=np.array(velocity),
        q_w_flu_wxyz=LEVEL,
        rate_flu_radps=zero,
        age_s=0.01,
        reference=Reference(zero, zero, np.array(accel_ref), 0.0),
        sent_accel_w_mps2=np.array(sent),
        dt_s=0.01,
    )


def leaning(accel: Array) -> Array:
    """Return the attitude whose thrust gives this acceleration."""
    return setpoint_of_accel(accel, 0.0, ThrustModel()).q_w_flu_wxyz


def test_all_four_are_shipped() -> None:
    assert [type(law) for law in SHIPPED] == [GeometricPid, Indi, L1Adaptive, LinearMpc]


@given(position=VECTOR, velocity=VECTOR, accel=VECTOR, known=VECTOR)
def test_without_a_disturbance_each_is_the_geometric_law(
    position: list[float], velocity: list[float], accel: list[float], known: list[float]
) -> None:
    """Lee 2010, eq. 15: the first cycle at a given state, before anything is learnt; of the integral one period."""
    now = replace(seen(position, velocity, accel), known_accel_w_mps2=np.array(known))
    plain = [accel[j] - KP[j] * position[j] - KD[j] * velocity[j] - known[j] for j in range(3)]
    learnt = [0.01 * 2.0 * (velocity[j] + 1.0 * position[j]) for j in range(3)]
    for law, first in zip(BARE, (learnt, [0.0] * 3, [0.0] * 3), strict=True):
        _, out = law.step(law.initial(now), now)
        np.testing.assert_allclose(out.accel_w_mps2, np.array(plain) - first, atol=1e-9)
        assert out.event == 1.0


def test_the_integral_stops_at_its_limit() -> None:
    law, far = BARE[0], seen([10.0, -10.0, 0.0], [0.0, 0.0, 0.0])
    memory = law.initial(far)
    for _ in range(300):
        memory, _ = law.step(memory, far)
    np.testing.assert_allclose(memory.integral, [3.0, -3.0, 0.0])


def test_the_low_pass_of_indi_has_the_response_of_its_transfer_function() -> None:
    """w^2 / (s^2 + sqrt 2 w s + w^2) at w is 1 / sqrt 2, a quarter of a period late."""
    w, dt, state = 5.0, 1e-4, LowPass(np.zeros(1), np.zeros(1))
    found = []
    for n in range(60_000):
        state = state.stepped(np.array([math.sin(w * n * dt)]), w, dt)
        found.append(state.output[0])
    late = np.array(found)[-int(2.0 * math.pi / w / dt) :]
    assert late.max() == pytest.approx(0.5**0.5, rel=1e-3)
    steps = np.arange(60_000)[-len(late) :]
    assert late @ np.sin(w * steps * dt) == pytest.approx(0.0, abs=2e-3 * len(late))


def test_indi_adds_what_the_measured_acceleration_lacks() -> None:
    """Smeur 2018, eqs. 15 to 19, two cycles by hand; level at hover thrust the rotors' acceleration is 0."""
    law, w = BARE[1], 6.0
    first, second = seen([0.0, 0.0, 0.0], [0.1, 0.0, 0.0]), seen([0.001, 0.0, 0.0], [0.11, 0.0, 0.0])
    memory, _ = law.step(law.initial(first), first)
    _, out = law.step(memory, second)
    measured = 0.01 * w * w * (0.11 - 0.1)  # the first cycle finds the filter at rest
    np.testing.assert_allclose(out.accel_w_mps2[0], -4.0 * 0.001 - 3.0 * 0.11 - measured, atol=1e-12)
    np.testing.assert_allclose(out.signals["measured"], [measured, 0.0, 0.0], atol=1e-12)


def test_the_adaptation_is_the_piecewise_constant_one() -> None:
    """Wu 2022: sigma_hat = -Phi^-1 e^(A_s T) v_tilde, by hand for two cycles at a constant push of 0.5 m/s^2."""
    law, a, t = BARE[2], 5.0, 0.01
    phi = (math.exp(-a * t) - 1.0) / -a
    v_hat = v = error = sigma = filtered = 0.0
    memory = law.initial(seen([0.0] * 3, [0.0] * 3))
    for n in range(5):
        v = 0.5 * n * t
        v_hat += t * (sigma - a * error)
        error = v_hat - v
        sigma = -math.exp(-a * t) / phi * error
        filtered += (1.0 - math.exp(-4.0 * t)) * (sigma - filtered)
        memory, out = law.step(memory, seen([0.0] * 3, [v, 0.0, 0.0]))
        np.testing.assert_allclose(out.signals["sigma"], [sigma, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(out.accel_w_mps2, [-3.0 * v - filtered, 0.0, 0.0], atol=1e-12)
    assert 0.4 < sigma < 0.55


def test_without_a_new_frame_no_estimate_moves() -> None:
    old = replace(seen([0.0] * 3, [0.3, 0.0, 0.0]), age_s=0.02)
    for law, name in ((BARE[1], "measured"), (BARE[2], "sigma")):
        memory = law.initial(seen([0.0] * 3, [0.0] * 3))
        _, out = law.step(memory, old)
        np.testing.assert_array_equal(out.signals[name], np.zeros(3))


def planned(law: LinearMpc, memory: MpcMemory, now: ControlInput) -> Array:
    """Return the moves along x."""
    return np.asarray(law.step(memory, now)[1].signals["moves"][0])


def simulated_cost(law: LinearMpc, moves: Array, start: tuple[float, float], push: float) -> float:
    """Return the cost of moves along x by integrating the attitude's lag in steps of 0.1 ms, at rest before them."""
    v, g, dt = law.vehicle, law.gains, 1e-4
    (p, speed), accel, jerk, w = start, 0.0, 0.0, law.vehicle.attitude_bandwidth_radps
    wait = round((v.mocap_age_s + v.setpoint_delay_s) / dt)
    block = round(BLOCK_S / dt)
    cost = 0.0
    for n in range(wait + MOVES * block):
        u = moves[(n - wait) // block] if n >= wait else 0.0
        bend = w * w * (u - accel) - 2.0 * v.attitude_damping * w * jerk
        p, speed = p + dt * speed + 0.5 * dt * dt * (accel + push), speed + dt * (accel + push)
        accel, jerk = accel + dt * jerk, jerk + dt * bend
        if n >= wait and (n + 1 - wait) % block == 0:
            cost += p * p + g.velocity_s**2 * speed * speed
    changes = np.diff(np.concatenate(([0.0], moves)))
    return float(cost + g.command_s4 * ((moves + push) ** 2).sum() + g.change_s4 * (changes**2).sum())


def test_the_moves_cost_less_than_any_near_them() -> None:
    """The program against a simulated vehicle that shares no code with it: 8 cm off, pushed by 0.3 m/s^2."""
    law = LinearMpc(MpcGains(send_from_mps2=0.0), VEHICLE, 0.01)
    now = seen([0.08, 0.0, 0.0], [0.05, 0.0, 0.0])
    memory = law.initial_with(now, np.array([0.3, 0.0, 0.0]))
    moves = planned(law, memory, now)
    _, out = law.step(memory, now)
    assert out.accel_w_mps2[0] == pytest.approx(moves[0])
    best = simulated_cost(law, moves, (0.08, 0.05), 0.3)
    for move in range(MOVES):
        for change in (-0.05, 0.05):
            near = moves.copy()
            near[move] += change
            assert simulated_cost(law, near, (0.08, 0.05), 0.3) > best


def test_moves_keep_their_bounds_and_cost_least_there() -> None:
    law = LinearMpc(MpcGains(send_from_mps2=0.0, max_accel_mps2=np.full(3, 0.5)), VEHICLE, 0.01)
    now = seen([0.5, 0.0, 0.0], [0.0, 0.0, 0.0])
    memory = law.initial(now)
    moves = planned(law, memory, now)
    assert moves[0] == pytest.approx(-0.5, abs=1e-6)
    assert np.abs(moves).max() <= 0.5 + 1e-6
    clipped = np.clip(planned(LinearMpc(MpcGains(), VEHICLE, 0.01), memory, now), -0.5, 0.5)
    start = (0.5, 0.0)
    assert simulated_cost(law, moves, start, 0.0) < simulated_cost(law, clipped, start, 0.0) - 1e-6


def test_a_missing_solver_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(ConfigError, match=r"^law = 'mpc' needs the solver daqp, which is not installed"):
        load_controller("mpc", VEHICLE, 0.01)


def test_the_trigger_sends_the_first_command_and_each_that_differs_enough() -> None:
    held = np.full(3, np.inf)
    wanted = [[0.0, 0.0, 0.0], [0.05, -0.09, 0.0], [0.05, -0.1, 0.0], [0.05, -0.1, 0.0]]
    events = []
    for one in wanted:
        held, event = send_on_change(held, np.array(one), 0.1)
        events.append(float(event[0]))
    assert events == [1.0, 0.0, 1.0, 0.0]
    np.testing.assert_array_equal(held, wanted[2])


@pytest.mark.parametrize("law", SHIPPED, ids=PEERS)
def test_each_passes_the_check_of_laws(law: PeerLaw[Any]) -> None:
    assert check_law(law, LawFile(Path("peer.py"), type(law).__name__), 0.01) is law


@pytest.mark.parametrize("law", SHIPPED, ids=PEERS)
@pytest.mark.parametrize("lead", [(5,), (2, 3)])
def test_a_batch_is_its_members_one_by_one(law: PeerLaw[Any], lead: tuple[int, ...]) -> None:
    given_ = inputs(lead, 8)
    memory, alone = law.initial(given_[0]), {index: law.initial(at(given_[0], index)) for index in np.ndindex(*lead)}
    for now in given_:
        memory, out = law.step(memory, now)
        for index in np.ndindex(*lead):
            alone[index], single = law.step(alone[index], at(now, index))
            np.testing.assert_allclose(out.accel_w_mps2[index], single.accel_w_mps2, rtol=1e-9, atol=1e-9)
            np.testing.assert_array_equal(out.event[index], single.event)
    for index, single in alone.items():
        for whole, part in zip(leaves(memory), leaves(single), strict=True):
            np.testing.assert_allclose(whole[index], part, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("law", SHIPPED, ids=PEERS)
def test_seeded_with_a_disturbance_each_counters_it_at_once(law: PeerLaw[Any]) -> None:
    """In a hover that counters it: level but for the attitude that it takes, at rest, nothing to correct."""
    known = np.array([0.3, -0.2, 0.1])
    now = replace(seen([0.0] * 3, [0.0] * 3, sent=-known), q_w_flu_wxyz=leaning(-known))
    every = law.without_trigger()
    _, out = every.step(every.initial_with(now, known), now)
    np.testing.assert_allclose(out.accel_w_mps2, -known, atol=0.02)


@pytest.mark.parametrize("law", SHIPPED, ids=PEERS)
def test_a_step_of_the_reference_settles(law: PeerLaw[Any]) -> None:
    """Fly from 20 places within half a metre, under 20 pushes, on the vehicle that the law is told of."""
    rng = np.random.default_rng(3)
    starts, pushes = rng.uniform(-0.5, 0.5, (20, 3)), rng.uniform(-0.3, 0.3, (20, 3))
    errors_m, _ = stepped(law.without_trigger(), starts, pushes, cycles=1200)
    assert np.abs(errors_m[-200:]).max() < 0.01
    errors_m, sent = stepped(law, starts, pushes, cycles=1200)
    threshold_m = law.gains.send_from_mps2 / law.gains.kp_per_s2.min() if isinstance(law, FeedbackLaw) else 0.03
    assert np.abs(errors_m[-200:]).max() < threshold_m
    assert sent[-200:].mean() < 0.2, "at rest the trigger is mostly quiet"


def stepped(law: PeerLaw[Any], starts: Array, pushes: Array, cycles: int) -> tuple[Array, Array]:
    """Return positions and events in each cycle; each axis is its lag behind its delay."""
    lag = second_order(VEHICLE.attitude_bandwidth_radps, VEHICLE.attitude_damping)
    ends = [exponential(0.01 * model) for model in (lag, lag, first_order(VEHICLE.thrust_lag_s))]
    free, driven = np.stack([end[:4, :4] for end in ends]), np.stack([end[:4, 4] for end in ends])
    state, zero = np.zeros((*starts.shape, 4)), np.zeros_like(starts)
    state[..., 0] = starts
    delays = [round(delay / 0.01) for delay in (VEHICLE.setpoint_delay_s,) * 2 + (VEHICLE.thrust_delay_s,)]
    sent, before, memory, rows = [zero] * (max(delays) + 1), state, None, []
    for _ in range(cycles):
        p, v, a, j = np.moveaxis(before, -1, 0)
        attitude = setpoint_of_accel(a, np.zeros(len(starts)), ThrustModel()).q_w_flu_wxyz
        now = replace(
            seen(p, v, sent=sent[-1]),
            q_w_flu_wxyz=attitude,
            rate_flu_radps=np.stack((-j[:, 1] / 9.8, j[:, 0] / 9.8, zero[:, 0]), axis=-1),
        )
        memory, out = law.step(law.initial(now) if memory is None else memory, now)
        sent = [*sent[1:], out.accel_w_mps2]
        acting = np.stack([sent[-1 - delay][:, axis] for axis, delay in enumerate(delays)], axis=-1)
        before, state = state, np.matmul(free, state[..., None])[..., 0] + acting[..., None] * driven
        state[..., 0] += 0.5 * 0.01**2 * pushes
        state[..., 1] += 0.01 * pushes
        rows.append((p, out.event))
    positions, events = zip(*rows, strict=True)
    return np.array(positions), np.array(events)


def test_the_adaptation_outlasts_frames_that_come_late_or_not_at_all() -> None:
    """Aged by sums that round, as in flight: after a gap it has not forgotten, and nothing has grown."""
    law, known, age_s = BARE[2], np.array([0.4, 0.0, 0.0]), 0.01
    memory = law.initial_with(seen([0.0] * 3, [0.0] * 3), known)
    for cycle in range(300):
        age_s = 0.01 if cycle % 7 in (0, 1, 4) else age_s + 0.01
        hover = replace(seen([0.0] * 3, [0.0] * 3, sent=-known), age_s=age_s, q_w_flu_wxyz=leaning(-known))
        memory, out = law.step(memory, hover)
        np.testing.assert_allclose(out.signals["disturbance"], known, atol=0.04)
