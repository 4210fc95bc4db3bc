"""Phase and gain margin of a control law on a vehicle, measured through the law's own `step`. No I/O, no clock.

Law and model of the vehicle fly in closed loop: at rest, then a kick at the plant's input along one axis. With U the
law's command and V = U + kick what the vehicle is given, the loop broken at the plant's input is L = -U/V at every
frequency, whatever is inside the law: prediction, observer, filters, network. The kick's size is the amplitude at which
a law that bends is linearised. A loop that does not come to rest has no margin: it oscillates, or its command chatters.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache

import numpy as np

from companion.control.compiled_law import compiled_law_of_many
from companion.control.controller import ControlInput, Controller, Law, Memory, VehicleModel
from companion.control.lag_models import exponential, first_order, second_order
from companion.core.types import Array, Reference
from companion.geometry.attitude import ThrustModel, setpoint_of_accel

KICKS_MPS = (0.02, 0.3)
"""Velocities that a kick gives: errors of 2 mm, where regularised powers are steepest, and of 5 to 10 cm."""
_SUBSTEPS = 4
"""Steps of the plant in a control cycle; delays are rounded to them."""
_REST_S = 2.0
"""Time before the kick, in which a law adapts what it learns at rest, such as kappa."""
_AFTER_S = 9.0
_TAPER_S = 3.0
"""Time over which the end of the response fades out: a slow integral has not quite come to rest."""
_FREQUENCIES_RADPS = np.geomspace(0.6, 30.0, 180)
_END_S = 2.0
"""Last part of the response, in which it should be at rest."""
_SWINGS_M = 0.06
"""Amplitude at the end above which the loop oscillates, chatter or not."""
_RESTS = 0.05
"""Largest amplitude of a command at rest, as a share of its maximum."""
_CHATTER = 0.3
"""Least ratio of the final amplitudes after small and large kick at which a command that never rests chatters."""
_FLEES_M = 2.0


class Verdict(StrEnum):
    """Result of a measurement of the margin."""

    MEASURED = "measured"
    SWINGS = "swings"
    CHATTERS = "chatters"
    """It stays in place, but its command never comes to rest: a trigger, a sgn, an unbounded slope."""


@dataclass(frozen=True, kw_only=True)
class Margin:
    """Margins of the worst axis and amplitude; angles or frequencies that do not exist are NaN."""

    verdict: Verdict
    axis: str
    """x, y or z."""
    phase_deg: float = math.nan
    """Phase margin; 180 where the loop's gain is never 1."""
    crossover_radps: float = math.nan
    """Frequency of the phase margin."""
    gain: float = math.nan
    """Gain margin: the factor by which the loop's gain may rise or fall; infinite where its phase never is -180."""
    swing_radps: float = math.nan
    """Frequency of the oscillation."""


class TooLongError(Exception):
    """Measurement that was stopped by its caller before the law was through."""


def measure_margin(
    law: Controller, vehicle: VehicleModel, period_s: float, go_on: Callable[[], bool] = lambda: True
) -> Margin:
    """Return the margins of a law that broadcasts over leading axes; exceptions of its `step` are raised.

    A trigger leaves a law silent between events: give it here with its trigger off if it has a switch for it. Raises
    TooLongError when `go_on`, called in every cycle, returns False.
    """
    responses = _fly(compiled_law_of_many(law), vehicle, period_s, go_on)
    margins = [response.margin() for response in responses]
    swinging = [margin for margin in margins if margin.verdict is Verdict.SWINGS]
    if swinging:
        return swinging[0]
    small, large = responses[:3], responses[-3:]
    for gentle, hard, margin in zip(small, large, margins, strict=False):
        if not hard.rests and gentle.end_mps2 > _CHATTER * hard.end_mps2:
            return replace(margin, verdict=Verdict.CHATTERS)
    phase = min(margins, key=lambda margin: margin.phase_deg)
    return replace(phase, gain=min(margin.gain for margin in margins))


@dataclass(frozen=True, kw_only=True)
class _Response:
    """Response of one axis to one kick, cycle by cycle."""

    axis: str
    period_s: float
    commanded_mps2: Array
    given_mps2: Array
    position_m: Array

    @property
    def _end(self) -> slice:
        return slice(-round(_END_S / self.period_s), None)

    @property
    def end_mps2(self) -> float:
        """Amplitude of the command at the end."""
        return float(np.ptp(self.commanded_mps2[self._end])) / 2.0

    @property
    def rests(self) -> bool:
        return self.end_mps2 < _RESTS * float(np.abs(self.commanded_mps2).max())

    def margin(self) -> Margin:
        end_m = self.position_m[self._end]
        if not np.abs(self.position_m).max() < _FLEES_M or np.ptp(end_m) / 2.0 > _SWINGS_M:
            return Margin(verdict=Verdict.SWINGS, axis=self.axis, swing_radps=self._swing_radps())
        loop = self._loop()
        log_gain, phase_rad = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
        at = _crossings(log_gain)
        phases = np.abs(np.degrees(np.angle(np.exp(1j * (_between(phase_rad, at) + np.pi)))))
        gains = _between(log_gain, _crossings(np.sin(0.5 * (phase_rad + np.pi))))
        worst = int(np.argmin(phases)) if len(phases) else -1
        return Margin(
            verdict=Verdict.MEASURED,
            axis=self.axis,
            phase_deg=float(phases[worst]) if len(phases) else 180.0,
            crossover_radps=float(_between(_FREQUENCIES_RADPS, at)[worst]) if len(phases) else math.nan,
            gain=float(np.exp(np.abs(gains).min())) if len(gains) else math.inf,
        )

    def _loop(self) -> Array:
        """Return the complex loop gain L at the frequencies."""
        waves = _waves(len(self.given_mps2), self.period_s)
        return np.asarray(-(waves @ self.commanded_mps2) / (waves @ self.given_mps2))

    def _swing_radps(self) -> float:
        """Return the frequency of the command from its changes of sign."""
        signs = np.sign(self.commanded_mps2[np.isfinite(self.commanded_mps2)])
        changes = np.flatnonzero(np.diff(signs[signs != 0.0]))[-6:]
        if len(changes) < 2:
            return math.nan
        return float(np.pi / (np.diff(changes).mean() * self.period_s))


@lru_cache(maxsize=1)
def _waves(count: int, period_s: float) -> Array:
    """Return a wave of each frequency, (frequencies, count), that fades out at the end."""
    time_s = np.arange(count) * period_s
    left = np.clip((time_s[-1] - time_s) / _TAPER_S, 0.0, 1.0)
    return np.asarray(np.exp(-1j * np.outer(_FREQUENCIES_RADPS, time_s)) * (0.5 - 0.5 * np.cos(np.pi * left)))


def _crossings(values: Array) -> Array:
    """Return the fractional indices at which values pass 0."""
    before = np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:]))
    return np.asarray(before + values[before] / (values[before] - values[before + 1]))


def _between(values: Array, at: Array) -> Array:
    """Return values interpolated at fractional indices."""
    return np.interp(at, np.arange(len(values)), values)


def _fly(law: Law[Memory], vehicle: VehicleModel, period_s: float, go_on: Callable[[], bool]) -> list[_Response]:
    """Fly all axes and kicks as one batch: x, y and z after the first kick, then after the next."""
    axes, kicks_mps = np.tile(np.arange(3), len(KICKS_MPS)), np.repeat(KICKS_MPS, 3)
    rows, plant = np.arange(len(axes)), _Plant(vehicle, period_s, len(axes))
    rest, cycles = round(_REST_S / period_s), round((_REST_S + _AFTER_S) / period_s)
    rows_of: list[tuple[Array, Array, Array]] = []
    sent, memory = np.zeros((len(axes), 3)), None
    with np.errstate(all="ignore"):  # divergence is a result
        for cycle in range(cycles):
            now = plant.measure(sent)
            memory = law.initial(now) if memory is None else memory
            memory, output = law.step(memory, now)
            sent = np.where(output.event > 0.0, output.accel_w_mps2, sent)
            given = sent.copy()
            if cycle == rest:
                given[rows, axes] += kicks_mps / period_s
            rows_of.append((sent[rows, axes], given[rows, axes], now.position_w_m[rows, axes]))
            if not (np.abs(now.position_w_m) < _FLEES_M).all():  # or no number
                break
            if not go_on():
                raise TooLongError
            plant.advance(given)
    after = min(rest, len(rows_of) - 1)
    commanded, given_all, position = (np.array(column)[after:] for column in zip(*rows_of, strict=True))
    return [
        _Response(
            axis="xyz"[axis],
            period_s=period_s,
            commanded_mps2=commanded[:, row],
            given_mps2=given_all[:, row],
            position_m=position[:, row],
        )
        for row, axis in enumerate(axes)
    ]


class _Plant:
    """Batch of vehicles at rest in the air, each axis linear: its lag, its delay, the age of its state."""

    def __init__(self, vehicle: VehicleModel, period_s: float, count: int) -> None:
        self._vehicle, self._period_s, self._count = vehicle, period_s, count
        step_s = period_s / _SUBSTEPS
        lag = second_order(vehicle.attitude_bandwidth_radps, vehicle.attitude_damping)
        ends = [exponential(step_s * system) for system in (lag, lag, first_order(vehicle.thrust_lag_s))]
        self._free, self._driven = np.stack([end[:4, :4] for end in ends]), np.stack([end[:4, 4] for end in ends])
        self._age = round(vehicle.mocap_age_s / step_s)
        delays_s = vehicle.setpoint_delay_s, vehicle.setpoint_delay_s, vehicle.thrust_delay_s
        self._delays = [round(delay_s / step_s) for delay_s in delays_s]
        nothing = np.zeros((count, 3, 4))
        self._states = [nothing] * (self._age + 1)
        """Position, velocity, acceleration and jerk of each axis; the last is now."""
        self._given = [np.zeros((count, 3))] * (max(self._delays) + 1)
        self._model = ThrustModel(vehicle.mass_kg, vehicle.gravity_mps2)

    def measure(self, sent_w_mps2: Array) -> ControlInput:
        """Return the input of the law now."""
        p, v, a, j = np.moveaxis(self._states[0], -1, 0)
        g, zero = self._vehicle.gravity_mps2, np.zeros((self._count, 3))
        q = setpoint_of_accel(a, np.zeros(self._count), self._model).q_w_flu_wxyz
        rate = np.stack((-j[:, 1] / g, j[:, 0] / g, zero[:, 0]), axis=-1)
        age_s = np.full((self._count, 1), self._vehicle.mocap_age_s)
        reference = Reference(zero, zero, zero, 0.0)
        return ControlInput(
            position_w_m=p.copy(),
            velocity_w_mps=v.copy(),
            q_w_flu_wxyz=q,
            rate_flu_radps=rate,
            age_s=age_s,
            reference=reference,
            sent_accel_w_mps2=sent_w_mps2,
            dt_s=self._period_s,
            known_accel_w_mps2=zero,
        )

    def advance(self, given_w_mps2: Array) -> None:
        """Advance by a control cycle with a command that is sent now."""
        for _ in range(_SUBSTEPS):
            self._given = [*self._given[1:], given_w_mps2]
            acting = np.stack([self._given[-1 - delay][:, axis] for axis, delay in enumerate(self._delays)], axis=-1)
            state = np.matmul(self._free, self._states[-1][..., None])[..., 0] + acting[..., None] * self._driven
            self._states = [*self._states[1:], state]
