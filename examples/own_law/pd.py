"""PD on a predicted state, less the push d that the predictor's observer sees: u = p_d'' - k_p e - k_d e' - d."""

import numpy as np

from companion.law_api import ControlInput, ControlOutput, Predictor, PredictorMemory, VehicleModel


class Pd:
    """The law; it sends in every cycle."""

    def __init__(self, gains: dict[str, float], vehicle: VehicleModel, period_s: float) -> None:
        self.kp, self.kd = gains["kp_per_s2"], gains["kd_per_s"]
        self.predictor = Predictor(vehicle, period_s, lead_s=0.1, thrust_lead_s=0.1, observer_radps=4.0)
        self.preview_s, self.initial = float(self.predictor.preview_s), self.predictor.initial

    def step(self, memory: PredictorMemory, now: ControlInput) -> tuple[PredictorMemory, ControlOutput]:
        """Run one cycle."""
        seen, memory = self.predictor.step(memory, now)
        error = seen.position_w_m - now.reference.position_w_m
        rate = seen.velocity_w_mps - now.reference.velocity_w_mps
        push = seen.disturbance_w_mps2 + now.known_accel_w_mps2
        accel = now.reference.acceleration_w_mps2 - self.kp * error - self.kd * rate - push
        return memory, ControlOutput(accel, np.ones_like(accel[..., :1]), {"error": error})
