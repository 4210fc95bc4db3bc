"""All that one flight says about vehicle and room, beside what is configured, with how sure it is."""

import math
from dataclasses import dataclass

import numpy as np

from companion.analysis.calibration.attitude import fit_attitude, fit_mocap_delay
from companion.analysis.calibration.fitting import Fit
from companion.analysis.calibration.signals import Observed, blocks
from companion.analysis.calibration.thrust import Hover, fit_rotors, hover
from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import VehicleConfig

_EXPLAINED = 0.8
"""A model that explains less of what is seen is not the vehicle's."""
_AUTOPILOT_S = 0.003
"""Longest delay of the autopilot's own attitude messages."""
_ROTORS_S = 0.005
"""Error of the fitted rotor lag in flights whose truth is known."""
_CURVE = 0.03
"""The same of the curve."""
_LINK_DELAY = "law.link.delay_s"
_LINK_BLOCK_S = 3.0
_LEAST_BLOCKS = 3
_CLOCKS_S = 0.0005
"""Error of the clock offset on a quiet network."""
_VARIED = 0.006
"""Share of hover thrust by which the thrust must vary."""


@dataclass(frozen=True)
class Finding:
    """A value of the configuration as the flight shows it."""

    name: str
    """Key as written in the configuration, with its table."""
    value: float
    sd: float
    configured: float
    digits: int
    says: str


@dataclass(frozen=True)
class Unknown:
    """Parameter that the flight does not determine, with the reason."""

    name: str
    why: str


@dataclass(frozen=True)
class Calibrated:
    """Result of a calibration: findings, and parameters left as they are."""

    findings: tuple[Finding, ...]
    left: tuple[Unknown, ...]

    def toml(self) -> str:
        """Return the lines to set in the configuration, as TOML."""
        tables: dict[str, list[str]] = {}
        for one in self.findings:
            table, _, key = one.name.rpartition(".")
            tables.setdefault(table, []).append(f"{key} = {one.value:.{one.digits}f}")
        return "\n".join(line for table, lines in tables.items() for line in (f"[{table}]", *lines))


def calibrate(seen: Observed, config: CompanionConfig) -> Calibrated:
    """Return each quantity by itself; those that cannot be determined well enough are listed as left."""
    vehicle = config.vehicle
    results: list[Finding | Unknown] = []
    delay = _mocap_delay(seen, config.mocap.delay_s)
    level = hover(seen, vehicle.gravity_mps2)
    results.append(_hover_thrust(level, vehicle.hover_thrust))
    known_s = delay.value if isinstance(delay, Finding) else config.mocap.delay_s
    results += _rotors(seen, level, known_s, vehicle)
    results += _attitude(fit_attitude(seen), known_s, vehicle)
    results.append(delay)
    results += _link_delay(seen, config.law.link.delay_s)
    findings = tuple(one for one in results if isinstance(one, Finding))
    return Calibrated(findings, tuple(one for one in results if isinstance(one, Unknown)))


def _mocap_delay(seen: Observed, configured_s: float) -> Finding | Unknown:
    name = "mocap.delay_s"
    if len(seen.heard_s) < 100:
        return Unknown(name, "the autopilot's attitude hardly came")
    found = fit_mocap_delay(seen)
    delay_s, sd_s = float(found.values[0]), math.hypot(float(found.sd[0]), _AUTOPILOT_S)
    if found.explained < _EXPLAINED:
        return Unknown(name, _unlike("the tilts that motion capture and the autopilot saw", found, "fly an ellipse"))
    if sd_s > 0.01 or delay_s < 0.0:
        return Unknown(name, f"{_ms(delay_s, sd_s)} is too uncertain: it must tilt more, fly an ellipse")
    says = "from capture to arrival, less what the autopilot's attitude takes to get here"
    if seen.linked_s.size:
        says += f"; of the {'ground' if seen.of_ground else 'vehicle'}'s frames"
    return Finding("mocap.delay_s", delay_s, sd_s, configured_s, 3, says)


def _link_delay(seen: Observed, configured_s: float) -> list[Finding | Unknown]:
    """Return the age of the messages of a law on the ground; nothing for a law on board."""
    if not seen.linked_s.size:
        return []
    block = blocks(seen.linked_s, _LINK_BLOCK_S)
    medians = np.array([np.median(seen.link_age_s[block == one]) for one in np.unique(block)])
    if len(medians) < _LEAST_BLOCKS:
        return [Unknown(_LINK_DELAY, "too few messages of the ground: hold for half a minute")]
    sd_s = math.hypot(float(medians.std(ddof=1)) / math.sqrt(len(medians)), _CLOCKS_S)
    says = "median age of a command at its arrival; wrong by half of what the way up takes longer than the way down"
    return [Finding(_LINK_DELAY, float(np.median(seen.link_age_s)), sd_s, configured_s, 3, says)]


def _hover_thrust(level: Hover | None, configured: float) -> Finding | Unknown:
    if level is None:
        return Unknown("vehicle.hover_thrust", "it hovered for less than 10 s: hold for half a minute, arms stowed")
    says = f"over {level.for_s:.0f} s, in which it varied by {level.spread:.4f} (standard deviation)"
    return Finding("vehicle.hover_thrust", level.thrust, level.sd, configured, 3, says)


def _rotors(seen: Observed, level: Hover | None, mocap_s: float, vehicle: VehicleConfig) -> list[Finding | Unknown]:
    names = ("vehicle.thrust_curve", "vehicle.thrust_lag_s")
    if level is None:
        return [Unknown(name, "hover thrust is not known") for name in names]
    rotors = fit_rotors(seen, level.thrust, vehicle.gravity_mps2)
    found = rotors.fit
    if rotors.varied < _VARIED:
        why = f"the thrust varied by {rotors.varied:.1%} only: {_CLIMB}"
        return [Unknown(name, why) for name in names]
    if found.explained < _EXPLAINED:
        why = _unlike("vertical motion and the thrust asked for", found, _CLIMB)
        return [Unknown(name, why) for name in names]
    curve, curve_sd = max(float(found.values[2]), 0.0), math.hypot(float(found.sd[2]), _CURVE)
    lag_s = float(found.values[0]) - mocap_s - vehicle.thrust_delay_s
    lag_sd_s = math.hypot(float(found.sd[0]), _ROTORS_S)
    results: list[Finding | Unknown] = []
    if curve_sd > 0.1:
        results.append(Unknown(names[0], f"{curve:.2f} ± {curve_sd:.2f} is too uncertain: {_CLIMB}"))
    else:
        says = "f in force = f t^2 + (1 - f) t, as PX4 leaves it"
        results.append(Finding("vehicle.thrust_curve", curve, curve_sd, vehicle.thrust_curve, 2, says))
    if lag_sd_s > 0.012 or lag_s <= 0.0:
        results.append(Unknown(names[1], f"{_ms(lag_s, lag_sd_s)} is too uncertain: {_CLIMB}"))
    else:
        says = f"with thrust_delay_s = {vehicle.thrust_delay_s:g} left as it is: only their sum shows"
        results.append(Finding("vehicle.thrust_lag_s", lag_s, lag_sd_s, vehicle.thrust_lag_s, 3, says))
    return results


def _attitude(found: Fit, mocap_s: float, vehicle: VehicleConfig) -> list[Finding | Unknown]:
    names = ("vehicle.setpoint_delay_s", "vehicle.attitude_bandwidth_radps", "vehicle.attitude_damping")
    total_s, bandwidth, damping = (float(value) for value in found.values)
    delay_sd_s, bandwidth_sd, damping_sd = (float(sd) for sd in found.sd)
    why = ""
    if found.explained < _EXPLAINED:
        why = _unlike("setpoints and measured attitude", found, "something else turned the vehicle")
    elif bandwidth_sd > 0.15 * bandwidth or delay_sd_s > 0.015 or damping_sd > 0.15:
        why = f"{bandwidth:.1f} ± {bandwidth_sd:.1f} rad/s is too uncertain: it must tilt more, fly an ellipse"
    if why:
        return [Unknown(name, why) for name in names]
    says = f"delay and second order explain {found.explained:.1%} of the motion; take all three"
    delay_s = max(total_s - mocap_s, 0.0)
    return [
        Finding(names[0], delay_s, delay_sd_s, vehicle.setpoint_delay_s, 3, says),
        Finding(names[1], bandwidth, bandwidth_sd, vehicle.attitude_bandwidth_radps, 2, says),
        Finding(names[2], damping, damping_sd, vehicle.attitude_damping, 2, says),
    ]


_CLIMB = "fly climbs and descents (docs/reports.md has a file)"


def _unlike(what: str, found: Fit, todo: str) -> str:
    return f"{what} agree in {max(found.explained, 0.0):.0%} of their motion only: {todo}"


def _ms(value_s: float, sd_s: float) -> str:
    return f"{1e3 * value_s:.0f} ± {1e3 * sd_s:.0f} ms"
