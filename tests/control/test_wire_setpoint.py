"""Correction of the horizon in the law's setpoint: sent with it, seldom by itself, inside the limits."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.control.horizon_correction import HorizonInput, HorizonRules
from companion.control.pipeline import same_setpoint
from companion.control.wire_setpoint import WireSetpoint
from companion.core.types import AttitudeThrust, Mask
from companion.geometry.frames import quat_from_rotation_vector, up_axis
from companion.guard.limits import Limits

DT_S = 0.01
LIMITS = Limits(max_tilt_rad=0.3)
RULES = HorizonRules()
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
HOVER = AttitudeThrust(LEVEL, np.array(0.5))


def off(x_rad: float, **changes: Any) -> HorizonInput:
    ours = quat_from_rotation_vector(np.array([x_rad, 0.0, 0.0]))
    return replace(
        HorizonInput(
            q_w_flu_wxyz=ours,
            rate_flu_radps=np.zeros(3),
            age_s=0.01,
            autopilot_q_w_flu_wxyz=LEVEL,
            autopilot_age_s=0.01,
            trusted=True,
            flying=True,
        ),
        **changes,
    )


def sent(stage: WireSetpoint, seen: list[HorizonInput], setpoint: AttitudeThrust = HOVER) -> list[AttitudeThrust]:
    """Return the setpoint on the wire after each cycle in which the law sends nothing new."""
    wire, wires = setpoint, []
    for now in seen:
        wire = stage.put(setpoint, False, wire, now, DT_S).setpoint
        wires.append(wire)
    return wires


def leaving(wires: list[AttitudeThrust]) -> int:
    return sum(not same_setpoint(a, b) for a, b in zip([HOVER, *wires], wires, strict=False))


def test_while_the_law_wants_nothing_new_a_correction_leaves_in_few_steps() -> None:
    wires = sent(WireSetpoint(RULES, LIMITS), [off(0.04)] * 600)
    assert 1 <= leaving(wires) <= 2, "0.04 rad in steps of 0.02"
    assert up_axis(wires[-1].q_w_flu_wxyz)[1] == pytest.approx(0.04, abs=float(RULES.resend_rad)), "rolled back by it"
    assert leaving(sent(WireSetpoint(RULES, LIMITS), [off(0.004)] * 600)) == 0


def test_with_a_new_setpoint_the_newest_correction_leaves() -> None:
    stage = WireSetpoint(RULES, LIMITS)
    wire = sent(stage, [off(0.04)] * 600)[-1]
    new = AttitudeThrust(quat_from_rotation_vector(np.array([0.0, 0.1, 0.0])), np.array(0.55))
    out = stage.put(new, True, wire, off(0.04), 1.0)
    assert up_axis(out.setpoint.q_w_flu_wxyz)[1] == pytest.approx(math.sin(0.04), abs=2e-3)
    assert out.setpoint.thrust == 0.55, "the thrust is not touched"


def test_what_leaves_is_inside_the_tilt_limit_and_turns_no_quicker_than_allowed() -> None:
    at_limit = AttitudeThrust(quat_from_rotation_vector(np.array([-0.3, 0.0, 0.0])), np.array(0.5))
    wires = sent(WireSetpoint(RULES, LIMITS), [off(0.04)] * 300, at_limit)
    assert min(up_axis(wire.q_w_flu_wxyz)[2] for wire in wires) >= math.cos(LIMITS.max_tilt_rad) - 1e-9
    slow = replace(LIMITS, max_turn_radps=0.1)
    stage, wire = WireSetpoint(RULES, slow), HOVER
    for k in range(300):
        before, wire = wire, stage.put(HOVER, k == 200, wire, off(0.04), DT_S).setpoint
        assert np.linalg.norm(wire.q_w_flu_wxyz - before.q_w_flu_wxyz) <= 0.5 * 0.1 * DT_S + 1e-9


def test_idle_rotors_stay_idle() -> None:
    idle = AttitudeThrust(LEVEL, np.array(0.0))
    out = WireSetpoint(RULES, LIMITS).put(idle, True, idle, off(0.0, flying=False), DT_S)
    assert out.setpoint.thrust == 0.0


def test_switched_off_the_laws_setpoint_itself_leaves() -> None:
    stage = WireSetpoint(HorizonRules(enabled=False), LIMITS)
    assert all(wire is HOVER for wire in sent(stage, [off(0.04)] * 100))


def test_after_a_reset_nothing_is_known() -> None:
    stage = WireSetpoint(RULES, LIMITS)
    sent(stage, [off(0.04)] * 300)
    stage.reset()
    out = stage.put(HOVER, True, HOVER, off(0.04), DT_S)
    assert out.begun
    assert out.horizon.x == 0.0
    assert same_setpoint(out.setpoint, HOVER)


def test_a_batch_is_its_vehicles() -> None:
    angles = (0.0, 0.02, 0.05)
    ours = np.stack([off(angle).q_w_flu_wxyz for angle in angles])
    still, level = np.zeros((3, 3)), np.broadcast_to(LEVEL, (3, 4))
    together = HorizonInput(
        q_w_flu_wxyz=ours,
        rate_flu_radps=still,
        age_s=0.01,
        autopilot_q_w_flu_wxyz=level,
        autopilot_age_s=0.01,
        trusted=True,
        flying=True,
    )
    batch, wire = WireSetpoint(RULES, LIMITS, (3,)), AttitudeThrust(level, np.full(3, 0.5))
    alone = [WireSetpoint(RULES, LIMITS) for _ in angles]
    wires: list[AttitudeThrust] = [HOVER] * 3
    for k in range(200):
        new: Mask = np.array([k % 7 == 0, k % 11 == 0, False])
        wire = batch.put(AttitudeThrust(level, np.full(3, 0.5)), new, wire, together, DT_S).setpoint
        for i, angle in enumerate(angles):
            wires[i] = alone[i].put(HOVER, bool(new[i]), wires[i], off(angle), DT_S).setpoint
    for i in range(3):
        assert wire.q_w_flu_wxyz[i] == pytest.approx(wires[i].q_w_flu_wxyz, abs=1e-12)
