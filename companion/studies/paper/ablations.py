"""The ET-NN law with one of its parts taken out: what is each worth?"""

from enum import StrEnum

from companion.config.controller_config import (
    ControllerFiles,
    EtnnFile,
    LoadedController,
    etnn_law,
    read_controller,
    read_etnn,
)
from companion.control.controller import VehicleModel
from companion.control.gains import EtnnGains


class Ablation(StrEnum):
    """A part of the law that can be left out. What the law is told of the arms is `feedforward` in [arms], not here."""

    NETWORK = "network"
    """Gamma_0 = Gamma_1 = 0 (eqs. update1, update2): V_1 stays 0, and with it f_hat."""
    TRIGGER = "trigger"
    """A command every cycle."""
    SWITCHING = "switching"
    """No sgn term in u_bar (eq. ETC-law)."""
    COMPENSATOR = "compensator"
    """iota_1 = iota_2 = 0 (eq. iota-dyn): dynamic-surface control. f_hat acts through iota_2, so it is off as well."""
    PREDICTION = "prediction"
    """The law sees the state as it is, as printed; without it there is no push observer, and no push to take off."""
    PUSH = "push"
    """No push is observed, so none is predicted with, and none is taken off the command, as printed."""


_PREDICTION: dict[Ablation, dict[str, object]] = {
    Ablation.PREDICTION: {"enabled": False},
    Ablation.PUSH: {"observer_radps": 0.0},
}
"""Changes in [prediction]."""


def ablated(file: EtnnFile, ablation: Ablation) -> EtnnFile:
    """The file's law without that part, all else the same; it may be unstable."""
    changes: dict[Ablation, dict[str, object]] = {
        Ablation.NETWORK: {"gamma_v0": 0.0 * file.gains.gamma_v0, "gamma_v1": 0.0 * file.gains.gamma_v1},
        Ablation.TRIGGER: {"every_cycle": True},
        Ablation.SWITCHING: {"switching": 0.0},
        Ablation.COMPENSATOR: {"compensation": 0.0},
        Ablation.PUSH: {"push_share": 0.0},
    }
    gains = EtnnGains.model_validate(file.gains.model_dump() | changes.get(ablation, {}))
    prediction = file.prediction.model_copy(update=_PREDICTION.get(ablation, {}))
    return file.model_copy(update={"gains": gains, "prediction": prediction})


def load_ablated(
    given: str | ControllerFiles, vehicle: VehicleModel, period_s: float, ablation: Ablation
) -> LoadedController:
    """The controller without that part, stable or not: what comes of it is what the experiment asks.

    Raises ConfigError for an unknown name, a bad file, or one whose law is not ET-NN.
    """
    files = read_controller(given)
    file = ablated(read_etnn(files), ablation)
    law = etnn_law(file, vehicle, period_s)
    return LoadedController(f"{files.name} without {ablation}", law, file.error_limits, file.description)
