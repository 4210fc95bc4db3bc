"""Pipeline of the ET-NN law for one vehicle, as numbers that compiled code takes and returns.

`command` and `settle` are the two halves of a cycle, of which the compiled ones are traces.
"""

from dataclasses import replace

import numpy as np

from companion.control.compiled_law import NO_LOOKAHEAD, Lookahead, NumberedPredictor, lookahead_of
from companion.control.controller import ControlInput, Controller
from companion.control.disturbance import Disturbance, no_disturbance
from companion.control.etnn import Decided, Etnn, EtnnMemory
from companion.control.gains import EtnnGains
from companion.control.network import NetworkState
from companion.control.pipeline import ControlPipeline
from companion.core.types import Array, AttitudeThrust, Flag, Mask, Reference, Scalar, VehicleState
from companion.core.values import value
from companion.geometry.attitude import ThrustModel
from companion.guard.limits import Limits

_LEVEL = np.array((1.0, 0.0, 0.0, 0.0))


@value
class Held:
    """Memory of the pipeline."""

    law: object
    setpoint: AttitudeThrust
    yaw_rad: Scalar
    arm_accel_w_mps2: Array
    disturbance: Disturbance


class Pipeline(ControlPipeline):
    """Pipeline whose memory can be set."""

    def _warm_up(self) -> None:
        self.forget()

    def begin(self, first: ControlInput, network: NetworkState) -> Held:
        """Return the memory at lift-off; ET-NN's with this network."""
        law = self._controller.initial(first)
        if isinstance(law, EtnnMemory):
            law = replace(law, network=network)
        return Held(law, AttitudeThrust(_LEVEL, np.zeros(())), 0.0, np.zeros(3), no_disturbance(first))

    def hold(self, memory: Held) -> None:
        """Go on from this memory."""
        self._memory, self._law_setpoint, self._yaw_rad = memory.law, memory.setpoint, memory.yaw_rad
        self._sent_arm_accel_w_mps2, self._disturbance = memory.arm_accel_w_mps2, memory.disturbance

    def held(self) -> Held:
        """Return the memory."""
        assert self._law_setpoint is not None
        assert self._disturbance is not None
        arms, disturbance = self._sent_arm_accel_w_mps2, self._disturbance
        return Held(self._memory, self._law_setpoint, self._yaw_rad, arms, disturbance)


class EtnnPipeline(Pipeline):
    """Pipeline of the ET-NN law."""

    def _take(self, controller: Controller) -> None:
        super()._take(controller)
        assert isinstance(controller, Etnn)
        self._halves = controller

    def decided(self) -> Decided:
        """Return the first half of the law's cycle."""
        assert isinstance(self._decided, Decided)
        return self._decided


@value(kw_only=True)
class Law:
    """Parameters of law, conversion and limits."""

    gains: EtnnGains
    lookahead: Lookahead
    model: ThrustModel
    limits: Limits

    def pipeline(self) -> EtnnPipeline:
        """Return the pipeline that flies it."""
        return EtnnPipeline(Etnn(self.gains, NumberedPredictor(self.lookahead)), self.model, self.limits)


def law_of(law: Controller, model: ThrustModel, limits: Limits) -> Law | None:
    """Return a law's parameters; None for a law that is not compiled."""
    lookahead = lookahead_of(law)
    if lookahead is None:
        return None
    assert isinstance(law, Etnn)
    return Law(gains=law.gains, lookahead=lookahead, model=model, limits=limits)


def example_law() -> Law:
    """Return parameters of the shapes that are compiled."""
    return Law(gains=EtnnGains(), lookahead=NO_LOOKAHEAD, model=ThrustModel(), limits=Limits())


@value(kw_only=True)
class CycleInput:
    """Inputs of one cycle."""

    state: VehicleState
    age_s: float
    ahead: Reference
    last: AttitudeThrust
    dt_s: float
    known_accel_w_mps2: Array


@value(kw_only=True)
class Commanded:
    """Output of one cycle: the setpoint inside the limits, what was cut, and what goes into the record."""

    setpoint: AttitudeThrust
    cut: tuple[Mask, Mask, Mask, Mask]
    """Not finite, tilt, thrust, slew."""
    is_new: Flag
    wanted: AttitudeThrust
    """The law's setpoint, before the limits."""
    sent_accel_w_mps2: Array
    accel_w_mps2: Array
    event: Array
    signals: tuple[Array, ...]


@value
class Halfway:
    """Values that the second half of a cycle needs beside the memory."""

    alpha1: Array
    y2: Array
    velocity_ref: Array
    acceleration_ref: Array
    dt_s: float


def command(memory: Held, given: CycleInput, law: Law) -> tuple[Held, Commanded, Halfway]:
    """Run law, conversion and limits up to the setpoint; the law's second half is `settle`."""
    pipeline, ahead = law.pipeline(), given.ahead
    pipeline.hold(memory)
    output = pipeline.fly(given.state, given.age_s, ahead, given.last, given.dt_s, given.known_accel_w_mps2)
    decided, limited, wanted = pipeline.decided(), output.limited, output.law_output
    assert isinstance(memory.law, EtnnMemory)
    after = replace(pipeline.held(), law=replace(memory.law, trigger=decided.trigger, predictor=decided.predictor))
    out = Commanded(
        setpoint=limited.setpoint,
        cut=(limited.not_finite, limited.tilt_cut, limited.thrust_cut, limited.slew_cut),
        is_new=output.is_new,
        wanted=pipeline.held().setpoint,
        sent_accel_w_mps2=output.given.sent_accel_w_mps2,
        accel_w_mps2=wanted.accel_w_mps2,
        event=wanted.event,
        signals=tuple(wanted.signals.values()),
    )
    halfway = Halfway(decided.alpha1, decided.y2, ahead.velocity_w_mps, ahead.acceleration_w_mps2, given.dt_s)
    return after, out, halfway


def settle(memory: EtnnMemory, halfway: Halfway, gains: EtnnGains) -> tuple[EtnnMemory, Array]:
    """Run the second half of the law's cycle; return its memory, and f_hat."""
    zero = np.zeros(3)
    now = ControlInput(
        position_w_m=zero,
        velocity_w_mps=zero,
        q_w_flu_wxyz=_LEVEL,
        rate_flu_radps=zero,
        age_s=0.0,
        reference=Reference(zero, halfway.velocity_ref, halfway.acceleration_ref, 0.0),
        sent_accel_w_mps2=zero,
        dt_s=halfway.dt_s,
    )
    decided = Decided(memory, memory.trigger, memory.predictor, now, halfway.alpha1, halfway.y2)
    after, signals = Etnn(gains).settle(decided)
    return after, signals["f_hat"]
