"""Controller files: which law, its gains, and the check that refuses an unstable set."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from companion.config.law_files import LAW_FORM, is_law_file, law_path, law_source, own_law
from companion.config.locations import default_config_path, named_file, names_in
from companion.config.text_files import read_text
from companion.config.toml_files import Section, tables_of, validate
from companion.control.controller import Controller, VehicleModel
from companion.control.delay_predictor import Predictor
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains, PidGains
from companion.control.peers.geometric_pid import GeometricPid, GeometricPidGains
from companion.control.peers.indi import Indi, IndiGains
from companion.control.peers.l1_adaptive import L1Adaptive, L1Gains
from companion.control.peers.linear_mpc import LinearMpc, MpcGains
from companion.control.peers.outer_loop import PeerGains, PeerLaw
from companion.control.pid import Pid
from companion.core.interfaces import ConfigError

ON_GROUND = "ground"
"""Name of the law in a service whose law runs on the ground."""


class PredictionConfig(Section):
    """Departure from the paper: carry the state forward over the known delays before the law sees it."""

    enabled: bool = Field(False, description="predict; false: the law sees the state as it is, as printed")
    lead_s: float = Field(0.1, ge=0.0, le=0.3, description="time to predict beyond the known delays, s")
    thrust_lead_s: float = Field(
        0.1, ge=0.0, le=0.3, description="time for which the newest thrust is taken to go on, s"
    )
    observer_radps: float = Field(
        0.0, ge=0.0, le=20.0, description="poles of the observer of a push that goes on; 0: none"
    )
    observer_trend: float = Field(
        0.0, ge=0.0, le=1.0, description="third pole of the observer, for a push that changes, as a share of the others"
    )


class ErrorLimits(Section):
    """Error limits that a flight under this law must keep to count as good."""

    mean_m: float = Field(0.05, gt=0.0, description="mean position error per axis, m")
    max_m: float = Field(0.20, gt=0.0, description="largest position error per axis, m")


class _LawFile(Section):
    """Keys that every controller file has."""

    law: str = Field(
        description='"etnn", "pid", "geometric-pid", "indi", "l1", "mpc", or "FILE.py:NAME" for a law of your own'
    )
    description: str = Field("", description="what reports say of it")
    error_limits: ErrorLimits = ErrorLimits()


class EtnnFile(_LawFile):
    """A file with law = "etnn"."""

    allow_unstable: bool = Field(
        False, description="load it although its filter loop is unstable, or its margin on the vehicle too small"
    )
    gains: EtnnGains = Field(default_factory=EtnnGains)
    prediction: PredictionConfig = PredictionConfig()

    @model_validator(mode="after")
    def _a_push_that_is_taken_off_is_observed(self) -> Self:
        observed = self.prediction.enabled and self.prediction.observer_radps > 0.0
        if self.gains.push_share > 0.0 and not observed:
            raise ValueError(
                f"gains.push_share = {self.gains.push_share:g}: must be 0 unless a push is observed, which needs "
                "prediction.enabled = true and prediction.observer_radps above 0"
            )
        return self


class PidFile(_LawFile):
    """A file with law = "pid"."""

    gains: PidGains = Field(default_factory=PidGains)


class PeerFile(_LawFile):
    """A file with another author's law."""

    gains: PeerGains
    tune: dict[str, tuple[float, float]] = Field(
        default_factory=dict,
        description="ranges that `companion tune` searches: a gain, or GAIN.z for its third number apart",
    )


class GeometricPidFile(PeerFile):
    """A file with law = "geometric-pid"."""

    gains: GeometricPidGains = Field(default_factory=GeometricPidGains)


class IndiFile(PeerFile):
    """A file with law = "indi"."""

    gains: IndiGains = Field(default_factory=IndiGains)


class L1File(PeerFile):
    """A file with law = "l1"."""

    gains: L1Gains = Field(default_factory=L1Gains)


class MpcFile(PeerFile):
    """A file with law = "mpc"."""

    gains: MpcGains = Field(default_factory=MpcGains)


PEERS: dict[str, tuple[type[PeerFile], Callable[[Any, VehicleModel, float], PeerLaw[Any]]]] = {
    "geometric-pid": (GeometricPidFile, GeometricPid),
    "indi": (IndiFile, Indi),
    "l1": (L1File, L1Adaptive),
    "mpc": (MpcFile, LinearMpc),
}
"""Files and laws of the peers, by the name in `law`."""


class OwnLawFile(_LawFile):
    """A file whose law is in a user's Python file: law = "my_law.py:MyLaw"; its gains are checked by that file."""

    gains: dict[str, Any] = Field(default_factory=dict, description="whatever the law's Python file asks for")


_LAWS = ", ".join(repr(law) for law in ("etnn", "pid", *PEERS))


@dataclass(frozen=True)
class LoadedController:
    """A law ready to fly, and what its file says of it."""

    name: str
    law: Controller
    error_limits: ErrorLimits
    description: str = ""
    """Description in the file, for reports; empty if there is none."""
    own_file: Path | None = None
    unstable_allowed: bool = False
    """It was asked to be loaded although it may be unstable on its vehicle."""


@dataclass(frozen=True)
class ControllerFiles:
    """Contents of a controller's files: all that loading it needs, also on a computer that does not have them."""

    name: str
    """Name or file as the user gave it."""
    path: Path
    text: str
    law_source: bytes | None
    """Python file of a user's own law; None for a built-in law, or when there is no such file."""

    @property
    def tables(self) -> dict[str, Any]:
        """Tables of the TOML; ConfigError when it is none."""
        return tables_of(self.text, self.path)


def controller_path(name: str) -> Path:
    """Return a controller's file: practical.toml for `etnn`, a name in config/controllers/, or a path; ConfigError."""
    path = named_file("controllers", "practical" if name == "etnn" else name)
    if path is not None:
        return path
    if name.endswith(".toml"):
        raise ConfigError(f"{name}: there is no such file")
    known = f"{', '.join(names_in('controllers'))} ({default_config_path('controllers')})"
    raise ConfigError(f"unknown controller {name!r}: give a TOML file, 'etnn', or one of {known}")


def controller_text(name: str) -> str:
    """Return the text of a controller file, for records; ConfigError as `controller_path`, or when it is no text."""
    return read_text(controller_path(name))


def read_controller(given: str | ControllerFiles) -> ControllerFiles:
    """Read a controller's files, unless they are given; ConfigError as `controller_text`, or when it is not TOML."""
    if isinstance(given, ControllerFiles):
        return given
    path, text = controller_path(given), controller_text(given)
    return ControllerFiles(given, path, text, law_source(tables_of(text, path).get("law"), path))


def load_controller(
    given: str | ControllerFiles, vehicle: VehicleModel, period_s: float, allow_unstable: bool = False
) -> LoadedController:
    """Load the law of a controller, by its name or from its files, for this vehicle and control period (s).

    Raises ConfigError for an unknown name, a bad file, a user's law that cannot work, or an unstable filter loop
    unless `allow_unstable` or the file itself allows that.
    """
    files = read_controller(given)
    name, path, data = files.name, files.path, files.tables
    law = data.get("law")
    if law == "etnn":
        file = validate(EtnnFile, data, path)
        allowed = allow_unstable or file.allow_unstable
        if not allowed:
            _refuse_unstable(file.gains, path, period_s)
        made = etnn_law(file, vehicle, period_s)
        return LoadedController(name, made, file.error_limits, file.description, unstable_allowed=allowed)
    if law == "pid":
        pid = validate(PidFile, data, path)
        allowed, text = allow_unstable, pid.description
        return LoadedController(name, Pid(pid.gains), pid.error_limits, text, unstable_allowed=allowed)
    if law in PEERS:
        peer = validate(PEERS[law][0], data, path)
        return LoadedController(
            name,
            peer_law(peer, vehicle, period_s),
            peer.error_limits,
            peer.description,
            unstable_allowed=allow_unstable,
        )
    if is_law_file(law):
        own = validate(OwnLawFile, data, path)
        flies = own_law(own.law, own.gains, path, files.law_source, vehicle, period_s)
        python = law_path(own.law, path)
        return LoadedController(name, flies, own.error_limits, own.description, python, allow_unstable)
    if law is None:
        raise ConfigError(f"{path}: has no law: a controller file says law = {_LAWS}, or {LAW_FORM}")
    raise ConfigError(f"{path}: law = {law!r}: must be {_LAWS}, or {LAW_FORM}")


def read_peer(given: str | ControllerFiles) -> PeerFile:
    """Read the file of another author's law; ConfigError for a bad file or any other law."""
    files = read_controller(given)
    path, data = files.path, files.tables
    if data.get("law") not in PEERS:
        raise ConfigError(f"{path}: law = {data.get('law')!r}: must be one of {', '.join(PEERS)} here")
    return validate(PEERS[data["law"]][0], data, path)


def peer_law(file: PeerFile, vehicle: VehicleModel, period_s: float) -> PeerLaw[Any]:
    """Return the law of a file."""
    return PEERS[file.law][1](file.gains, vehicle, period_s)


def read_etnn(given: str | ControllerFiles) -> EtnnFile:
    """Read the file of an ET-NN law, stable or not; ConfigError for a bad file or another law."""
    files = read_controller(given)
    path, data = files.path, files.tables
    if data.get("law") != "etnn":
        raise ConfigError(f"{path}: law = {data.get('law')!r}: must be 'etnn' here")
    return validate(EtnnFile, data, path)


def etnn_law(file: EtnnFile, vehicle: VehicleModel, period_s: float) -> Etnn:
    """Return the law of a file, stable or not."""
    p = file.prediction
    if not p.enabled:
        return Etnn(file.gains)
    return Etnn(file.gains, Predictor(vehicle, period_s, p.lead_s, p.thrust_lead_s, p.observer_radps, p.observer_trend))


def _refuse_unstable(gains: EtnnGains, path: Path, period_s: float) -> None:
    damping, needed = gains.filter_loop()
    if damping <= needed:
        raise ConfigError(
            f"{path}: the loop of command filter and compensation is unstable: gains.rho / gains.filter_eps = "
            f"{damping:.3g} must be larger than k + s = {needed:.3g} (s: steepest secant of k_1 Theta); lower "
            "filter_eps, raise rho, or load it all the same with allow_unstable = true in it (demo, simulate and "
            "experiments: --allow-unstable)"
        )
    load = gains.filter_step_load(period_s)
    if load >= 4.0:
        raise ConfigError(
            f"{path}: gains.filter_eps = {gains.filter_eps:g} is too quick for steps of {period_s:g} s: "
            f"2 rho dt/eps + zeta (dt/eps)^2 = {load:.3g} must be below 4; raise filter_eps, lower rho, or run faster"
        )
