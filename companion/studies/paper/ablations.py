"""Laws with one of their parts taken out: what is each worth?"""

from collections.abc import Iterator
from enum import StrEnum

from companion.config.controller_config import (
    PEERS,
    ControllerFiles,
    EtnnFile,
    LoadedController,
    PeerFile,
    etnn_law,
    peer_law,
    read_controller,
    read_etnn,
    read_peer,
)
from companion.control.controller import Controller, VehicleModel
from companion.control.gains import EtnnGains
from companion.control.peers.outer_loop import FeedbackGains
from companion.core.interfaces import ConfigError


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


def parts_of(given: str | ControllerFiles) -> Iterator[Ablation]:
    """Yield the parts that a controller's law has and can fly without; none of a law that is neither ours nor a peer's.

    Raises ConfigError for an unknown name or a bad file.
    """
    files = read_controller(given)
    law = files.tables.get("law")
    if law == "etnn":
        file = read_etnn(files)
        yield from (part for part in Ablation if ablated(file, part).model_dump_json() != file.model_dump_json())
    elif law in PEERS:
        gains = read_peer(files).gains
        if gains.send_from_mps2 > 0.0:
            yield Ablation.TRIGGER
        if isinstance(gains, FeedbackGains) and gains.predict:
            yield Ablation.PREDICTION


def ablated_peer(file: PeerFile, ablation: Ablation) -> PeerFile:
    """Return a peer's file without that part, one of `parts_of`, all else the same."""
    change = {"send_from_mps2": 0.0} if ablation is Ablation.TRIGGER else {"predict": False}
    return file.model_copy(update={"gains": file.gains.model_copy(update=change)})


def load_ablated(
    given: str | ControllerFiles, vehicle: VehicleModel, period_s: float, ablation: Ablation
) -> LoadedController:
    """Load a controller without that part, stable or not: the experiment asks what comes of it.

    Raises ConfigError for an unknown name, a bad file, or one whose law is neither ET-NN nor a peer's.
    """
    files = read_controller(given)
    file: EtnnFile | PeerFile
    law: Controller
    if files.tables.get("law") in PEERS:
        if ablation not in parts_of(files):
            raise ConfigError(f"{files.path}: its law has no {ablation} to leave out")
        file = ablated_peer(read_peer(files), ablation)
        law = peer_law(file, vehicle, period_s)
    else:
        file = ablated(read_etnn(files), ablation)
        law = etnn_law(file, vehicle, period_s)
    return LoadedController(f"{files.name} without {ablation}", law, file.error_limits, file.description)
