"""Steps of a control cycle and of the simulated vehicle that are compiled, as they are written in Python.

Each function here only calls the ordinary ones, with numbers that write down what is done to them. What it takes and
returns is named, so that flight.c can pass it on. `python -m companion.simulation.traces` writes traced.c.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Protocol, cast

import numpy as np

import companion.compiled
from companion.compiled.c_source import CFunction, traced
from companion.control.compiled import cycle
from companion.control.compiled.cycle import CycleInput, Halfway, Held, Law, Pipeline, command, example_law
from companion.control.compiled.wire import NO_HORIZONS, Horizons, NumberedWire, Sending, corrected
from companion.control.compiled_law import NO_LOOKAHEAD, Lookahead, NumberedPredictor
from companion.control.controller import ControlInput
from companion.control.etnn import Etnn, EtnnMemory
from companion.control.gains import EtnnGains
from companion.control.horizon_correction import HorizonInput, HorizonRules
from companion.control.network import NetworkState, initial_network
from companion.core.types import Array, AttitudeThrust, Reference, VehicleState
from companion.core.values import value
from companion.estimation import attitude as att
from companion.estimation import estimator, usual_frame
from companion.estimation.estimator import EstimatorParams
from companion.estimation.kalman import Motion
from companion.estimation.usual_frame import NOT_FOLLOWED, Filters, Followed, Measured
from companion.geometry.array_math import where_each
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector, quat_multiply, turned
from companion.guard.limits import Limits
from companion.simulation.virtual_world import STEP_S
from mock_autopilot.physics import plant_one, quaternion_one
from mock_autopilot.physics.arm_bodies import Moving
from mock_autopilot.physics.arms import Assembly, Coupling
from mock_autopilot.physics.plant import PlantParams, at_rest
from mock_autopilot.physics.plant_one import Fixed, OneActuation, OneState
from mock_autopilot.physics.quaternion_one import Four, Three
from mock_autopilot.px4.attitude_error import turn_of
from mock_autopilot.servos.motor import XM430_W350, Motor

Numbers = tuple[float, ...]
SOURCE = Path(companion.compiled.__file__).with_name("traced.c")
_LEVEL = np.array((1.0, 0.0, 0.0, 0.0))


@value(kw_only=True)
class Given:
    """Inputs of one cycle that change: state, reference, the setpoint sent last, what is known of the arms."""

    state: VehicleState
    age_s: float
    ahead: Reference
    last: AttitudeThrust
    known_accel_b_mps2: Array


def begin_estimate(pose: Numbers, params: EstimatorParams) -> dict[str, object]:
    """Begin the filters with one pose: position and rotation matrix row by row."""
    of_motion, of_attitude = estimator.first_covariances(params)
    zero = (0.0, 0.0, 0.0)
    rotation = np.array(pose[3:]).reshape(3, 3)
    return {"after": Filters(Motion(pose[:3], zero, zero, of_motion), att.at_rest(rotation, of_attitude))}


def estimate(before: Filters, pose: Numbers, dt_s: float, params: EstimatorParams) -> dict[str, object]:
    """Advance the filters by an accepted pose; `accepted` is 1 where its verdict can be no other."""
    after, accepted = usual_frame.corrected(before, pose, dt_s, params)
    return {"after": after, "accepted": (accepted,)}


def follow(before: Followed, frame: Measured, params: EstimatorParams) -> dict[str, object]:
    """Advance the estimator of a flight by a usual frame; `usual` is 1 where it is one."""
    after, usual = usual_frame.take(before, frame, params)
    motion, attitude = after.filters.motion, after.filters.attitude
    captured_s = usual_frame.captured_s(after, params)
    state = (captured_s, motion.position, motion.velocity, attitude.q, attitude.rate)
    return {"after": after, "usual": (usual,), "state": state}


class Flown(Protocol):
    """Parameters of a law, of the conversion and of the limits."""

    def pipeline(self) -> Pipeline:
        """Return the pipeline that flies it."""


def begin_law(given: Given, law: Flown, dt_s: float, network: NetworkState) -> dict[str, object]:
    """Return the pipeline's memory at lift-off."""
    known = turned(given.state.q_w_flu_wxyz, given.known_accel_b_mps2)
    first = law.pipeline()._given(given.state, given.age_s, given.ahead, given.last, dt_s, known)
    return {"after": law.pipeline().begin(first, network)}


def fly(memory: Held, given: Given, law: Flown, dt_s: float) -> dict[str, object]:
    """Run one cycle of law, conversion and limits."""
    pipeline, known = law.pipeline(), turned(given.state.q_w_flu_wxyz, given.known_accel_b_mps2)
    pipeline.hold(memory)
    output = pipeline.fly(given.state, given.age_s, given.ahead, given.last, dt_s, known)
    pipeline.settle()
    command = (output.law_output.accel_w_mps2, output.law_output.event)
    return {"after": pipeline.held(), "setpoint": output.limited.setpoint, "command": command}


def pilot(memory: Held, given: CycleInput, law: Law) -> dict[str, object]:
    """Run one cycle of a flight up to its setpoint."""
    after, out, halfway = command(memory, given, law)
    return {"after": after, "out": out, "halfway": halfway}


def decide(memory: EtnnMemory, now: ControlInput, gains: EtnnGains, lookahead: Lookahead) -> dict[str, object]:
    """Run the first half of the law's cycle, with the internal values that go into the record."""
    decided, output = Etnn(gains, NumberedPredictor(lookahead)).decide(memory, now)
    after = EtnnMemory(memory.filter, memory.network, decided.trigger, decided.predictor)
    return {"after": after, "output": (output.accel_w_mps2, output.event, tuple(output.signals.values()))}


def settle(memory: EtnnMemory, halfway: Halfway, gains: EtnnGains) -> dict[str, object]:
    """Run the second half of the law's cycle."""
    after, f_hat = cycle.settle(memory, halfway, gains)
    return {"after": after, "f_hat": (f_hat,)}


@value(kw_only=True)
class VirtualSending:
    """Setpoint to be corrected, and both attitudes that it is corrected by."""

    setpoint: AttitudeThrust
    is_new: bool
    last: AttitudeThrust
    state: VehicleState
    age_s: float
    autopilot_q_w_flu_wxyz: Array
    autopilot_age_s: float


def send(
    before: Horizons, given: VirtualSending, rules: HorizonRules, limits: Limits, dt_s: float
) -> dict[str, object]:
    """Correct the autopilot's horizon in a setpoint, while the law flies and motion capture is trusted."""
    wire = NumberedWire(HorizonRules(**vars(rules) | {"enabled": True}), limits)
    wire.hold(before)
    put = wire.put(given.setpoint, given.is_new, given.last, _seen(given), dt_s)
    return {"after": wire.horizons(), "wire": put.setpoint}


def _seen(given: VirtualSending) -> HorizonInput:
    return HorizonInput(
        q_w_flu_wxyz=given.state.q_w_flu_wxyz,
        rate_flu_radps=given.state.rate_flu_radps,
        age_s=given.age_s,
        autopilot_q_w_flu_wxyz=given.autopilot_q_w_flu_wxyz,
        autopilot_age_s=given.autopilot_age_s,
        trusted=True,
        flying=True,
    )


def wire(before: Horizons, given: Sending, rules: HorizonRules, limits: Limits) -> dict[str, object]:
    """Correct the autopilot's horizon in a setpoint of a flight."""
    after, out = corrected(before, given, rules, limits)
    return {"after": after, "out": out}


@value(kw_only=True)
class Airframe:
    """Simulated vehicle's state: plant, and the reaction of the arms."""

    state: OneState
    rate_before: Three
    trimmed: Three


@value(kw_only=True)
class Driven:
    """Setpoint, force and arms that act on the simulated vehicle during one step."""

    q_w_flu_wxyz: Array
    signal: float
    turn: Four
    """The autopilot's horizon, as `turn_of` gives it."""
    force_ned_n: Three
    moving: Moving
    carried: float
    """1 with arms."""


@value(kw_only=True)
class Carrier:
    """Parameters of the simulated vehicle."""

    fixed: Fixed
    mass_kg: float
    inertia_kgm2: Array
    trim_s: Array


def step(before: Airframe, driven: Driven, carrier: Carrier) -> dict[str, object]:
    """Advance the simulated vehicle by a step."""
    state, arms = before.state, Coupling(None, 1.0, np.ones(3), (1.0, 1.0, 1.0))
    p, r, y = carrier.trim_s
    arms._mass_kg, arms._inertia_kgm2, arms._trim_time_s = carrier.mass_kg, carrier.inertia_kgm2, (p, r, y)
    arms._rate, arms._trimmed = before.rate_before, before.trimmed
    rate, q = state.rate_frd_radps, state.q_ned_frd_wxyz
    (i, j, k), push = arms.pushed(rate, q, state.thrust_n, state.on_ground, driven.moving, carrier.fixed.dt_s)
    x, y, z = driven.force_ned_n
    carried = driven.carried != 0.0
    force = where_each(carried, (x + i, y + j, z + k), (x, y, z))
    push = where_each(carried, push, (0.0, 0.0, 0.0))
    w, a, b, c = driven.q_w_flu_wxyz.tolist()
    tw, tx, ty, tz = driven.turn
    asked = OneActuation(quaternion_one.multiply((w, a, -b, -c), (tw, -tx, -ty, -tz)), driven.signal)
    moved = plant_one.moved(state, asked, force, push, carrier.fixed)
    return {"after": Airframe(state=moved, rate_before=rate, trimmed=arms._trimmed)}


def horizon_turn(error_rad: Four, share: tuple[float]) -> dict[str, object]:
    """Interpolate the error of the autopilot's horizon between two samples."""
    (a, b, c, d), (s,) = error_rad, share
    return {"turn": turn_of(a + s * (c - a), b + s * (d - b))}


def look(pose: Numbers, noise: Array, size: Numbers) -> dict[str, object]:
    """Return the pose that motion capture measures: position, and rotation row by row.

    `noise` are six standard normals, `size` the deviations of position (m) and attitude (rad).
    """
    (x, y, z, w, i, j, k), (size_m, size_rad) = pose, size
    a, b, c = (noise[:3] * size_m).tolist()
    q = quat_multiply(np.array((w, i, -j, -k)), quat_from_rotation_vector(noise[3:] * size_rad))
    return {"measured": (x + a, b - y, c - z, *matrix_from_quat(q).ravel().tolist())}


def report(q_ned_frd_wxyz: Four, turn: Four) -> dict[str, object]:
    """Return the attitude that the autopilot believes, in W."""
    w, x, y, z = quaternion_one.multiply(q_ned_frd_wxyz, turn)
    return {"believed": (w, x, -y, -z)}


@value(kw_only=True)
class Servo:
    """Settings of a powered servo whose profile is unlimited: it is at the goal at once."""

    stall_nm: float
    no_load_radps: float
    inertia_kgm2: float
    friction_nm: float
    gain_per_rad: float
    margin_rad: float
    pwm_limit: float
    current_limit_nm: float


def servo_of(motor: Motor) -> Servo:
    """Return the settings of a motor."""
    return Servo(
        stall_nm=motor._stall_nm,
        no_load_radps=motor._no_load_radps,
        inertia_kgm2=motor.spec.inertia_kgm2,
        friction_nm=motor.spec.friction_nm,
        gain_per_rad=motor.gain_per_rad,
        margin_rad=motor.margin_rad,
        pwm_limit=motor.pwm_limit,
        current_limit_nm=motor.current_limit_nm,
    )


def turn(before: Numbers, goal_rad: float, load_nm: float, servo: Servo, dt_s: float) -> dict[str, object]:
    """Turn a servo for a step: its angle and rate."""
    spec = replace(XM430_W350, inertia_kgm2=servo.inertia_kgm2, friction_nm=servo.friction_nm)
    motor = Motor(spec, 0.0)
    motor._stall_nm, motor._no_load_radps = servo.stall_nm, servo.no_load_radps
    motor.gain_per_rad, motor.margin_rad = servo.gain_per_rad, servo.margin_rad
    motor.pwm_limit, motor.current_limit_nm = servo.pwm_limit, servo.current_limit_nm
    motor.power(on=True)
    motor.go_to(goal_rad)
    motor.angle_rad, motor.rate_radps = before
    motor.step(dt_s, load_nm)
    return {"after": (motor.angle_rad, motor.rate_radps)}


def weigh(angle_rad: Numbers, assembly: Assembly) -> dict[str, object]:
    """Return the links' weight as torque on each servo."""
    return {"load_nm": assembly.loads_nm(angle_rad)}


def assembly_numbers(assembly: Assembly) -> Assembly:
    """Return the same with directions that are numbers, which a trace takes as inputs."""
    return replace(assembly, direction=tuple(map(float, assembly.direction)))  # type: ignore[arg-type]


def functions(flown: Flown | None = None) -> list[CFunction]:
    """Trace everything that is compiled, with ET-NN or another law."""
    zero, level, three, four = np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0)), (0.0,) * 3, (0.0,) * 4
    pose, params = (0.0,) * 12, EstimatorParams()
    state, setpoint = VehicleState(0.0, zero, zero, level, zero), AttitudeThrust(level, np.array(0.0))
    given = Given(
        state=state,
        age_s=0.0,
        ahead=Reference(zero, zero, zero, 0.0),
        last=setpoint,
        known_accel_b_mps2=zero,
    )
    law, network = flown or example_law(), initial_network(EtnnGains())
    first = law.pipeline()._given(state, 0.0, given.ahead, setpoint, 0.01, zero)
    memory, etnn = law.pipeline().begin(first, network), example_law().pipeline().begin(first, network)
    of_flight = CycleInput(state=state, age_s=0.0, ahead=given.ahead, last=setpoint, dt_s=0.01, known_accel_w_mps2=zero)
    sending = VirtualSending(
        setpoint=setpoint,
        is_new=False,
        last=setpoint,
        state=state,
        age_s=0.0,
        autopilot_q_w_flu_wxyz=level,
        autopilot_age_s=0.0,
    )
    sent = Sending(setpoint=setpoint, is_new=False, last=setpoint, inputs=_seen(sending), dt_s=0.01)
    airframe = Airframe(state=plant_one.in_floats(at_rest(zero)), rate_before=three, trimmed=three)
    driven = Driven(
        q_w_flu_wxyz=level,
        signal=0.0,
        turn=four,
        force_ned_n=three,
        moving=Moving(three, three, three, three),
        carried=1.0,
    )
    carrier = carrier_of(PlantParams(), zero, zero, ())
    return [
        traced("begin_estimate", begin_estimate, pose=pose, params=params),
        traced("estimate", estimate, before=NOT_FOLLOWED.filters, pose=pose, dt_s=0.01, params=params),
        traced("follow", follow, before=NOT_FOLLOWED, frame=Measured(pose, 0.0, 0.0), params=params),
        traced("begin_law", begin_law, given=given, law=law, dt_s=0.01, network=network),
        traced("fly", fly, memory=memory, given=given, law=law, dt_s=0.01, fixed=("law", "dt_s")),
        traced("decide", decide, memory=etnn.law, now=first, gains=EtnnGains(), lookahead=NO_LOOKAHEAD),
        traced("settle", settle, memory=etnn.law, halfway=Halfway(zero, zero, zero, zero, 0.01), gains=EtnnGains()),
        traced("pilot", pilot, memory=etnn, given=of_flight, law=example_law(), fixed=("law",)),
        traced(
            "send",
            send,
            before=NO_HORIZONS,
            given=sending,
            rules=HorizonRules(),
            limits=Limits(),
            dt_s=0.01,
            fixed=("rules", "limits", "dt_s"),
        ),
        traced("wire", wire, before=NO_HORIZONS, given=sent, rules=HorizonRules(), limits=Limits()),
        traced("step", step, before=airframe, driven=driven, carrier=carrier),
        traced("horizon_turn", horizon_turn, error_rad=four, share=(0.0,)),
        traced("look", look, pose=(0.0,) * 7, noise=np.zeros(6), size=(0.0, 0.0)),
        traced("report", report, q_ned_frd_wxyz=four, turn=four),
        traced(
            "turn", turn, before=(0.0, 0.0), goal_rad=0.0, load_nm=0.0, servo=servo_of(Motor(XM430_W350, 0.0)), dt_s=0.0
        ),
        traced("weigh", weigh, angle_rad=(0.0,) * 8, assembly=assembly_numbers(Assembly())),
    ]


def carrier_of(params: PlantParams, inertia_kgm2: Array, trim_s: Array, lead: tuple[int, ...]) -> Carrier:
    """Return the parameters of one vehicle, or of a batch of shape `lead`."""
    known = params.coefficients(STEP_S, (*lead, 3))
    fixed = Fixed(
        dt_s=STEP_S,
        max_thrust_n=cast(float, params.max_thrust_n),
        motor_curve=cast(float, params.motor_curve),
        ground_z_m=params.ground_z_m,
        dry_per_mps=known.dry_per_mps,
        per_kg=cast(float, known.per_kg[..., 0]),
        **{name: getattr(known, name) for name in _BY_AXIS},
    )
    return Carrier(fixed=fixed, mass_kg=cast(float, params.mass_kg), inertia_kgm2=inertia_kgm2, trim_s=trim_s)


_BY_AXIS = (
    *("stiffness", "damping", "torque_gain", "torque_mean", "viscous", "quadratic", "coulomb"),
    *("thrust_gain", "thrust_mean"),
)


def source(traces: list[CFunction]) -> str:
    """Return the C source of these functions."""
    parts = [_HEAD, *(trace.layout for trace in traces), "", *(trace.source for trace in traces)]
    return "\n".join(parts)


_HEAD = """/* Written by `python -m companion.simulation.traces` from the Python that it names; not to be edited. */
"""


def main() -> None:
    """Write traced.c; with --check only say whether it is what would be written."""
    fresh = source(functions())
    if "--check" not in sys.argv:
        SOURCE.write_text(fresh, encoding="utf-8")
    elif SOURCE.read_text(encoding="utf-8") != fresh:
        sys.exit(f"{SOURCE} is not what the Python says: run python -m companion.simulation.traces")


if __name__ == "__main__":
    main()
