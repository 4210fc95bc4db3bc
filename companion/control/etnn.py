"""Control law of the paper: one cycle of ET-NN, in the order in which the paper defines its signals."""

from dataclasses import dataclass, replace

import numpy as np

from companion.control import command_filter as cf
from companion.control import event_trigger as et
from companion.control import network as nn
from companion.control.controller import ControlInput, ControlOutput
from companion.control.delay_predictor import Prediction, Predictor, PredictorMemory
from companion.control.gains import EtnnGains
from companion.core.types import Array
from companion.core.values import value


@value
class EtnnMemory:
    """Memory of the law from one cycle to the next."""

    filter: cf.FilterState
    network: nn.NetworkState
    trigger: et.TriggerState
    predictor: PredictorMemory | None


@value
class Decided:
    """Cycle whose command is computed and whose internal states are still to be advanced."""

    before: EtnnMemory
    trigger: et.TriggerState
    predictor: PredictorMemory | None
    now: ControlInput
    alpha1: Array
    y2: Array


@dataclass(frozen=True)
class Etnn:
    """Event-triggered neural-network law of the paper, with an optional predictor in front of it."""

    gains: EtnnGains
    predictor: Predictor | None = None

    @property
    def preview_s(self) -> float:
        """Time ahead to which the state is predicted, at which the reference is needed; 0 as printed."""
        return float(self.predictor.preview_s) if self.predictor else 0.0

    def initial(self, first: ControlInput) -> EtnnMemory:
        """Return the memory at lift-off: filter at its input, network untrained, nothing sent."""
        lead = first.position_w_m.shape[:-1]
        predictor = self.predictor.initial(first) if self.predictor else None
        x1 = first.position_w_m - first.reference.position_w_m
        alpha1 = cf.virtual_control_1(first.reference.velocity_w_mps, x1, np.zeros_like(x1), self.gains)
        network = nn.initial_network(self.gains, lead)
        return EtnnMemory(cf.at_lift_off(alpha1), network, et.initial_trigger(self.gains, lead), predictor)

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> EtnnMemory:
        """Return the memory of a law that has flown here for long: disturbance learnt, filter and compensation at rest.

        The observer holds the whole disturbance. The share that is not subtracted from the command is held by the bias
        of the network's output: f_hat, from which u -> -f_hat follows once iota_1 and iota_2 have settled.
        """
        g, start = self.gains, self.initial(now)
        known = known_disturbance_w_mps2 + np.zeros_like(now.position_w_m)
        left, predictor = known, start.predictor
        if self.predictor is not None and predictor is not None:
            predictor = self.predictor.with_disturbance(predictor, known)
            left = known * (1.0 - g.push_share) if np.any(self.predictor.observer_radps) else known
        state, _ = self._state(EtnnMemory(start.filter, start.network, start.trigger, predictor), now)
        iota1, iota2 = cf.compensation_at_rest(left, g)
        y1 = state.position_w_m - now.reference.position_w_m - iota1
        alpha1 = cf.virtual_control_1(now.reference.velocity_w_mps, y1, iota1, g)
        filtered = cf.in_motion(alpha1, now.reference.acceleration_w_mps2 - self._past(now), iota1, iota2, g)
        return EtnnMemory(filtered, nn.with_bias(start.network, left, g), start.trigger, predictor)

    def step(self, memory: EtnnMemory, now: ControlInput) -> tuple[EtnnMemory, ControlOutput]:
        """Run one cycle: errors, virtual controls, network, trigger, then every inner state advanced by dt_s."""
        decided, output = self.decide(memory, now)
        after, more = self.settle(decided)
        return after, replace(output, signals=output.signals | more)

    def decide(self, memory: EtnnMemory, now: ControlInput) -> tuple[Decided, ControlOutput]:
        """Run the first half of a cycle: everything that the command depends on."""
        g, f = self.gains, memory.filter
        state, predictor = self._state(memory, now)
        reference = now.reference
        x1 = state.position_w_m - reference.position_w_m
        y1 = x1 - f.iota1
        alpha1 = cf.virtual_control_1(reference.velocity_w_mps, y1, f.iota1, g)
        y2 = state.velocity_w_mps - f.chi - f.iota2
        alpha2 = cf.virtual_control_2(f.xi + self._past(now), x1, y2, f.iota2, g)
        u_bar = et.continuous_control(alpha2, y2, memory.trigger.kappa, g) - now.known_accel_w_mps2
        if self.predictor:
            u_bar = u_bar - g.push_share * state.disturbance_w_mps2
        trigger, u, event = et.trigger_step(memory.trigger, u_bar, g, now.dt_s)
        signals = {
            "x1": x1,
            "y1": y1,
            "y2": y2,
            "alpha1": alpha1,
            "alpha2": alpha2,
            "u_bar": u_bar,
            "chi": f.chi,
            "xi": f.xi,
            "iota1": f.iota1,
            "iota2": f.iota2,
            "kappa": memory.trigger.kappa,
            "push": state.disturbance_w_mps2,
        }
        return Decided(memory, trigger, predictor, now, alpha1, y2), ControlOutput(u, event, signals)

    def settle(self, decided: Decided) -> tuple[EtnnMemory, dict[str, Array]]:
        """Advance network, filter and compensation by dt_s; return also f_hat and its weights for the record.

        The command of a cycle does not depend on them: f_hat enters iota_2' alone (eq. iota-dyn).
        """
        g, before, dt_s = self.gains, decided.before, decided.now.dt_s
        x_d, phi = nn.hidden_layer(before.network, decided.now.reference.velocity_w_mps)
        f_hat = nn.output(before.network, phi)
        after = EtnnMemory(
            cf.filter_step(before.filter, decided.alpha1, f_hat, g, dt_s, self._past(decided.now)),
            nn.network_step(before.network, x_d, phi, decided.y2, g, dt_s),
            decided.trigger,
            decided.predictor,
        )
        return after, {"f_hat": f_hat, "v0": before.network.v0, "v1": before.network.v1}

    def _past(self, now: ControlInput) -> Array:
        """Return the part of alpha_1' (m/s^2) that goes past the filter: it is known, and would come late out of it."""
        return np.asarray(self.gains.past_filter * now.reference.acceleration_w_mps2)

    def _state(self, memory: EtnnMemory, now: ControlInput) -> tuple[Prediction, PredictorMemory | None]:
        if self.predictor is None or memory.predictor is None:
            return Prediction(now.position_w_m, now.velocity_w_mps, 0.0 * now.velocity_w_mps), None
        return self.predictor.step(memory.predictor, now)
