"""Controller files against the vehicle they are loaded for: phase and gain margin, and the sentence that refuses one.

How a margin is measured: companion/control/margin.py. Reading a law's file is the only I/O here.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from companion.config.controller_config import LoadedController, controller_text
from companion.config.text_files import read_text
from companion.control.controller import Controller, VehicleModel
from companion.control.etnn import Etnn
from companion.control.margin import Margin, TooLongError, Verdict, measure_margin
from companion.control.peers.outer_loop import PeerLaw
from companion.core.interfaces import ConfigError

LEAST_PHASE_DEG = 20.0
"""At the crossover of the ET-NN set that is shipped these are 60 ms of delay, or an attitude loop slower by a third,
that nobody has measured; with less a gust rings for seconds."""
LEAST_GAIN = 1.5
"""A battery that sags, a mass or hover thrust that is wrong by a fifth, and the slope of a law that bends, together."""
LONGEST_S = 20.0
"""A law that takes longer for eleven seconds of flight in a batch of six is not measured."""
REMEDY = (
    "lower its gains, or fly another law; if the attitude loop was never measured, `companion calibrate` does it "
    "(serve, demo, simulate and dry-run take the law all the same with --allow-unstable)"
)
_LEAST = f"at least {LEAST_PHASE_DEG:g} degrees and a gain margin of {LEAST_GAIN:g} are wanted"

_KNOWN: dict[tuple[object, ...], "Margin | str"] = {}
"""Margins measured in this process (a fifth to half a second each), by the text of the files, vehicle and period."""


@dataclass(frozen=True)
class LawMargin:
    """Result of the check of a law's margin on this vehicle."""

    says: str
    """Result with numbers, or the reason why it was not checked."""
    enough: bool
    """False: it is refused. What cannot be checked is not refused."""


Measure = Callable[[LoadedController, VehicleModel, float], "Margin | str"]
"""Measures the margins of a law on a vehicle at a period (s), or says why there are none."""


def measured(loaded: LoadedController, vehicle: VehicleModel, period_s: float) -> "Margin | str":
    """Return the margins, or why there are none: up to half a second of work."""
    end_s = time.monotonic() + LONGEST_S
    try:
        return measure_margin(_without_trigger(loaded.law), vehicle, period_s, lambda: time.monotonic() < end_s)
    except TooLongError:
        return f"one flight of {LONGEST_S:.0f} s on this computer was not enough for it"
    except Exception as error:
        if loaded.own_file is None:
            raise
        return f"its step raised {type(error).__name__}: {error}"


def margin_of(
    loaded: LoadedController, vehicle: VehicleModel, period_s: float, measure: Measure = measured
) -> LawMargin:
    """Return what the law's margins on this vehicle are; measured once in a process."""
    own = read_text(loaded.own_file) if loaded.own_file is not None else ""
    key = (loaded.name, controller_text(loaded.name), own, vehicle, period_s)
    if key not in _KNOWN:
        _KNOWN[key] = measure(loaded, vehicle, period_s)
    return _judged(_KNOWN[key], vehicle)


def require_margin(
    loaded: LoadedController, vehicle: VehicleModel, period_s: float, measure: Measure = measured
) -> LawMargin:
    """Return the margins; ConfigError, one sentence, for a law that has too little and was not allowed to.

    Beside a flight loop they are to be measured in another process (`margin_process`).
    """
    margin = margin_of(loaded, vehicle, period_s, measure)
    if margin.enough or loaded.unstable_allowed:
        return margin
    raise ConfigError(f"{loaded.name}: {margin.says}: {REMEDY}")


def _without_trigger(law: Controller) -> Controller:
    """Return a law with a command in every cycle: a trigger is a bounded disturbance, as sigma + kappa/delta."""
    if isinstance(law, Etnn):
        return replace(law, gains=law.gains.model_copy(update={"every_cycle": True}))
    if isinstance(law, PeerLaw):
        return law.without_trigger()
    return law


def _judged(found: "Margin | str", vehicle: VehicleModel) -> LawMargin:
    if isinstance(found, str):
        return LawMargin(f"margin not checked: {found}", enough=True)
    if found.verdict is Verdict.CHATTERS:
        why = f"its command never comes to rest along {found.axis} (a trigger, a sgn, or a slope without bound)"
        return LawMargin(f"margin not checked: {why}", enough=True)
    here = f"on this vehicle ({_described(vehicle)})"
    if found.verdict is Verdict.SWINGS:
        often = f" at {found.swing_radps / math.tau:.1f} Hz" if math.isfinite(found.swing_radps) else ""
        return LawMargin(f"no phase margin {here}: it swings along {found.axis}{often}; {_LEAST}", enough=False)
    at = f" at {found.crossover_radps:.1f} rad/s" if math.isfinite(found.crossover_radps) else ""
    degrees, gain = math.floor(found.phase_deg), math.floor(10.0 * min(found.gain, 99.0)) / 10.0  # no more than it is
    says = f"phase margin {degrees} degrees along {found.axis}{at}, gain margin {gain:g}"
    enough = found.phase_deg >= LEAST_PHASE_DEG and found.gain >= LEAST_GAIN
    return LawMargin(says if enough else f"{says} {here}; {_LEAST}", enough)


def _described(vehicle: VehicleModel) -> str:
    v = vehicle
    return (
        f"attitude loop {v.attitude_bandwidth_radps:g} rad/s, damping {v.attitude_damping:g}, setpoint delay "
        f"{v.setpoint_delay_s:g} s, thrust lag {v.thrust_lag_s:g} s, age of the pose {v.mocap_age_s:g} s"
    )
