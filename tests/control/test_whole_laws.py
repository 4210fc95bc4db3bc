"""Whole steps: against the law written out by hand, in batches, and without touching what they are given."""

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from companion.control.controller import ControlInput, Controller, VehicleModel
from companion.control.delay_predictor import Predictor
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains, PidGains
from companion.control.network import initial_network
from companion.control.pid import Pid
from companion.core.types import Array, Reference
from tests.control.by_hand import PRINTED, PRINTED_NUMBERS, ByHand, alpha_1

VEHICLE = VehicleModel()
PREDICTOR = Predictor(VEHICLE, 0.01, 0.1, 0.03)
DEPARTED = EtnnGains(
    filter_eps=0.06, zeta=1.2, rho=0.68, power_regularisation=0.01, boundary_layer_mps=0.3, v1_max=0.3, sigma=0.4
)
LAWS: list[Controller] = [
    Etnn(EtnnGains()),
    Etnn(DEPARTED),
    Etnn(DEPARTED, PREDICTOR),
    Pid(PidGains()),
]
NAMES = ["printed", "with departures", "with prediction", "pid"]


def reference(time_s: float, lead: tuple[int, ...] = ()) -> Reference:
    p = np.array([np.cos(time_s), 0.6 * np.sin(time_s), 1.0])
    v = np.array([-np.sin(time_s), 0.6 * np.cos(time_s), 0.0])
    a = np.array([-np.cos(time_s), -0.6 * np.sin(time_s), 0.0])
    p, v, a = (np.broadcast_to(x, (*lead, 3)) for x in (p, v, a))
    return Reference(p, v, a, 0.3)


def inputs(lead: tuple[int, ...], cycles: int, seed: int = 7) -> list[ControlInput]:
    """Vehicles that wander about the reference."""
    rng = np.random.default_rng(seed)
    found = []
    for n in range(cycles):
        q = rng.normal(size=(*lead, 4)) * 0.1 + np.array([1.0, 0.0, 0.0, 0.0])
        q /= np.sqrt((q * q).sum(axis=-1, keepdims=True))
        there = reference(0.01 * n, lead)
        found.append(
            ControlInput(
                position_w_m=there.position_w_m + rng.normal(0.0, 0.1, (*lead, 3)),
                velocity_w_mps=there.velocity_w_mps + rng.normal(0.0, 0.1, (*lead, 3)),
                q_w_flu_wxyz=q,
                rate_flu_radps=rng.normal(0.0, 0.5, (*lead, 3)),
                age_s=0.012,
                reference=there,
                sent_accel_w_mps2=rng.normal(0.0, 1.0, (*lead, 3)),
                dt_s=0.01,
                known_accel_w_mps2=rng.normal(0.0, 0.3, (*lead, 3)) if lead else np.zeros(3),
            )
        )
    return found


def at(value: Any, index: tuple[int, ...]) -> Any:
    """One member of a batch; what is no array has none of its own."""
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: at(getattr(value, f.name), index) for f in fields(value)})
    return value[index] if isinstance(value, np.ndarray) else value


def leaves(value: Any) -> list[Array]:
    if is_dataclass(value) and not isinstance(value, type):
        return [leaf for f in fields(value) for leaf in leaves(getattr(value, f.name))]
    if isinstance(value, dict):
        return [leaf for item in value.values() for leaf in leaves(item)]
    return [value] if isinstance(value, np.ndarray) else []


def test_two_hundred_cycles_of_the_printed_law_are_those_written_out_by_hand() -> None:
    gains = EtnnGains(v0_max=1e6, v1_max=1e6)
    law, seen = Etnn(gains), inputs((), 200)
    memory = law.initial(seen[0])
    first = seen[0]
    x1 = (first.position_w_m - first.reference.position_w_m).tolist()
    start = alpha_1(first.reference.velocity_w_mps.tolist(), x1, [0.0] * 3, PRINTED, 0.75, 1e-4)
    hand = ByHand(PRINTED, PRINTED_NUMBERS, initial_network(gains).v0.tolist(), start)
    events = 0
    for now in seen:
        memory, out = law.step(memory, now)
        ref = now.reference
        u, event = hand.step(
            now.position_w_m.tolist(),
            now.velocity_w_mps.tolist(),
            ref.position_w_m.tolist(),
            ref.velocity_w_mps.tolist(),
            0.01,
        )
        assert bool(out.event[0]) == event
        np.testing.assert_allclose(out.accel_w_mps2, u, rtol=1e-9, atol=1e-9)
        events += event
    np.testing.assert_allclose(memory.network.v0, hand.v0, rtol=1e-9)
    np.testing.assert_allclose(memory.network.v1, hand.v1, rtol=1e-9)
    np.testing.assert_allclose(memory.filter.iota1, hand.iota1, rtol=1e-9)
    np.testing.assert_allclose(memory.filter.iota2, hand.iota2, rtol=1e-9)
    np.testing.assert_allclose(memory.trigger.kappa[0], hand.kappa, rtol=1e-9)
    assert events > 100, "the state jumps by 10 cm a cycle here: most cycles are events"


@pytest.mark.parametrize("law", [Etnn(EtnnGains()), Pid(PidGains())], ids=["etnn", "pid"])
def test_what_the_arms_are_known_to_do_is_taken_off_the_command(law: Controller) -> None:
    now, pushed_mps2 = inputs((), 1)[0], np.array([0.3, -0.2, 0.1])
    _, calm = law.step(law.initial(now), now)
    known = replace(now, known_accel_w_mps2=pushed_mps2)
    _, countered = law.step(law.initial(known), known)
    np.testing.assert_allclose(countered.accel_w_mps2, calm.accel_w_mps2 - pushed_mps2, atol=1e-12)


def test_the_network_enters_the_compensation_and_not_the_command() -> None:
    law, now = Etnn(EtnnGains()), inputs((), 1)[0]
    memory = law.initial(now)
    taught = replace(memory, network=replace(memory.network, v1=np.ones((5, 3))))
    after, out = law.step(memory, now)
    after_taught, out_taught = law.step(taught, now)
    np.testing.assert_array_equal(out_taught.accel_w_mps2, out.accel_w_mps2)
    push = after_taught.filter.iota2 - after.filter.iota2
    np.testing.assert_allclose(push, 0.01 * out_taught.signals["f_hat"], atol=1e-12)
    assert np.all(out_taught.signals["f_hat"] > 1.0)


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
@pytest.mark.parametrize("lead", [(5,), (2, 3)])
def test_a_batch_is_its_members_one_by_one(law: Controller, lead: tuple[int, ...]) -> None:
    seen = inputs(lead, 12)
    memory = law.initial(seen[0])
    alone = {index: law.initial(at(seen[0], index)) for index in np.ndindex(*lead)}
    for now in seen:
        memory, out = law.step(memory, now)
        assert out.accel_w_mps2.shape == (*lead, 3)
        assert out.event.shape == (*lead, 1)
        for index in np.ndindex(*lead):
            alone[index], single = law.step(alone[index], at(now, index))
            np.testing.assert_allclose(out.accel_w_mps2[index], single.accel_w_mps2, rtol=1e-12, atol=1e-12)
            np.testing.assert_array_equal(out.event[index], single.event)
            for name, signal in single.signals.items():
                np.testing.assert_allclose(out.signals[name][index], signal, rtol=1e-12, atol=1e-12, err_msg=name)
    for index, single in alone.items():
        for whole, part in zip(leaves(memory), leaves(single), strict=True):
            np.testing.assert_allclose(whole[index], part, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
def test_a_step_changes_nothing_it_was_given(law: Controller) -> None:
    for lead in ((), (3,)):
        seen = inputs(lead, 3)
        memory = law.initial(seen[0])
        for now in seen:
            given_ = [leaf.copy() for leaf in leaves(memory) + leaves(now)]
            after, _ = law.step(memory, now)
            for before, leaf in zip(given_, leaves(memory) + leaves(now), strict=True):
                np.testing.assert_array_equal(before, leaf)
            memory = after


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
def test_the_same_memory_and_input_give_the_same_step(law: Controller) -> None:
    now = inputs((), 2)
    memory = law.initial(now[0])
    once, again = law.step(memory, now[1]), law.step(memory, now[1])
    for a, b in zip(leaves(once[0]) + leaves(once[1]), leaves(again[0]) + leaves(again[1]), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_reference_is_wanted_for_the_instant_predicted_for() -> None:
    assert Etnn(EtnnGains()).preview_s == 0.0
    assert Etnn(EtnnGains(), PREDICTOR).preview_s == pytest.approx(VEHICLE.setpoint_delay_s + 0.1)


def test_a_batch_of_gains_flies_each_vehicle_under_its_own() -> None:
    """A search for gains relies on this: diagonals (B, 3) and scalars (B, 1)."""
    rng = np.random.default_rng(11)
    count, base = 4, EtnnGains()
    diagonals = ("c1", "k1", "beta1", "gamma1", "c2", "k2", "beta2", "gamma2", "k")
    scalars = (
        "filter_eps",
        "zeta",
        "rho",
        "sigma",
        "delta",
        "power_regularisation",
        "boundary_layer_mps",
        "push_share",
    )
    own = {name: getattr(base, name) * rng.uniform(0.5, 2.0, (count, 3)) for name in diagonals}
    own |= {name: rng.uniform(0.05, 0.5, (count, 1)) for name in scalars}
    own |= {"gamma_v0": rng.uniform(0.5, 5.0, (count, 4)), "gamma_v1": rng.uniform(0.5, 5.0, (count, 5))}
    rest = {name: getattr(base, name) for name in EtnnGains.model_fields}
    lead_s, thrust_lead_s, observer_radps = rng.uniform(0.02, 0.1, (3, count, 1))
    many = Etnn(
        EtnnGains.model_construct(**(rest | own)), Predictor(VEHICLE, 0.01, lead_s, thrust_lead_s, observer_radps)
    )
    seen = inputs((count,), 12)
    memory = many.initial(seen[0])
    outputs = []
    for now in seen:
        memory, out = many.step(memory, now)
        outputs.append(out)
    for i in range(count):
        single = {name: value[i] if value.shape[-1] > 1 else float(value[i, 0]) for name, value in own.items()}
        predictor = Predictor(
            VEHICLE, 0.01, float(lead_s[i, 0]), float(thrust_lead_s[i, 0]), float(observer_radps[i, 0])
        )
        law = Etnn(base.model_copy(update=single), predictor)
        alone = law.initial(at(seen[0], (i,)))
        for now, out in zip(seen, outputs, strict=True):
            alone, expected = law.step(alone, at(now, (i,)))
            np.testing.assert_allclose(out.accel_w_mps2[i], expected.accel_w_mps2, rtol=1e-11, atol=1e-11)
            np.testing.assert_array_equal(out.event[i], expected.event)


def test_a_share_of_the_observed_push_is_taken_off_the_command() -> None:
    """Hovering, pushed by 0.5 m/s^2 along x for a second: u_bar is less by that share of what is observed."""
    predictor = Predictor(VEHICLE, 0.01, 0.1, 0.03, observer_radps=6.0)
    still, level, push = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])
    seen = [
        ControlInput(
            position_w_m=0.5 * t * t * push,
            velocity_w_mps=t * push,
            q_w_flu_wxyz=level,
            rate_flu_radps=still,
            age_s=0.01,
            reference=Reference(still, still, still, 0.0),
            sent_accel_w_mps2=still,
            dt_s=0.01,
        )
        for t in np.arange(100) * 0.01
    ]
    commanded = {}
    for share in (0.0, 0.8):
        law = Etnn(DEPARTED.model_copy(update={"push_share": share}), predictor)
        memory = law.initial(seen[0])
        for now in seen:
            memory, out = law.step(memory, now)
        commanded[share] = out
    observed = commanded[0.8].signals["push"]
    assert observed[0] > 0.45, "it is found within a second"
    taken = commanded[0.8].signals["u_bar"] - commanded[0.0].signals["u_bar"]
    np.testing.assert_allclose(taken, -0.8 * observed, atol=1e-12)
