"""Linear model-predictive control with a disturbance estimate: one quadratic program an axis and cycle.

M. Kamel, T. Stastny, K. Alexis, R. Siegwart, "Model predictive control for trajectory tracking of unmanned aerial
vehicles using robot operating system", in: Robot Operating System (ROS) 2, Springer 2017, section 3: the attitude loop
as a linear lag, the disturbance estimated and taken as constant over the horizon, box constraints. The program is
condensed: positions and velocities ahead are linear in the state, in the commands that are still on their way, and in
the moves, which alone are unknown (J. M. Maciejowski, "Predictive Control with Constraints", 2002, chapter 3). So this
law brings its own prediction, with the same model of lags and delays as `delay_predictor`, and needs no lead.

Without an active constraint the optimum is linear in what is seen, and is computed as such for a whole batch. Where a
move leaves its bounds the solver DAQP is called: D. Arnström, A. Bemporad, D. Axehill, "A dual active-set solver for
embedded quadratic programming using recursive LDL' updates", IEEE TAC 67(8), 2022.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from pydantic import Field

from companion.control.controller import ControlInput, ControlOutput, VehicleModel
from companion.control.disturbance_observer import DisturbanceEstimate, Poles, nothing_observed, observe
from companion.control.gains import Diagonal, Positive, diagonal
from companion.control.lag_models import exponential, first_order, second_order
from companion.control.peers.outer_loop import LoopMemory, PeerGains, PeerLaw
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.core.values import value

MOVES = 8
"""Moves in the horizon, each held for BLOCK_S; errors count at the end of each."""
BLOCK_S = 0.1
_COMMAND = 4
"""Column of the command in the models of `lag_models`; their rows are position, velocity, acceleration, jerk."""


class MpcGains(PeerGains):
    """Weights of the cost e_p^2 + tau^2 e_v^2 + rho (u - u_d)^2 + mu (change of u)^2, the observer, and the bounds."""

    velocity_s: Positive = Field(0.2, description="tau: weight of velocity errors, s")
    command_s4: Positive = Field(1e-3, description="rho: weight of a command that differs from the reference's, s^4")
    change_s4: Positive = Field(1e-3, description="mu: weight of each change of the command, s^4")
    observer_radps: Positive = Field(6.0, le=20.0, description="poles of the disturbance observer, rad/s")
    max_accel_mps2: Diagonal = diagonal(4.0, 4.0, 4.0, note="bound of each move, m/s^2")


@value
class MpcMemory:
    """Memory of the law: shared parts, and the observer."""

    loop: LoopMemory
    observed: DisturbanceEstimate


@dataclass(frozen=True)
class LinearMpc(PeerLaw[MpcMemory]):
    """Law that sends the first of the moves that cost least over the horizon."""

    gains: MpcGains

    def __post_init__(self) -> None:
        """Condense the program and load the solver now, not in the first cycle in the air."""
        _ = self._program, self._solve

    @property
    def preview_s(self) -> float:
        """Time ahead of now at which the law needs its reference: the middle of the horizon."""
        return self.vehicle.setpoint_delay_s + 0.5 * MOVES * BLOCK_S

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> MpcMemory:
        """Return the memory whose observer holds a known disturbance (m/s^2), (..., 3)."""
        nothing = nothing_observed(now.velocity_w_mps, now.age_s)
        known, acting = known_disturbance_w_mps2 + nothing.disturbance, now.sent_accel_w_mps2 + nothing.accel
        return MpcMemory(self.begin(now), replace(nothing, disturbance=known, accel=acting))

    def step(self, memory: MpcMemory, now: ControlInput) -> tuple[MpcMemory, ControlOutput]:
        """Return the memory and the command of one cycle."""
        sight, loop = self.look(memory.loop, now)
        poles = Poles(self.gains.observer_radps)
        observed = observe(memory.observed, now.velocity_w_mps, sight.acting_w_mps2, now.age_s, now.dt_s, poles)
        errors = self._coasting(loop, observed.disturbance, now)
        feedforward = now.reference.acceleration_w_mps2 - observed.disturbance
        moves = self._bounded(self._program.best(*errors, feedforward, now.sent_accel_w_mps2))
        signals = {"disturbance": observed.disturbance, "moves": moves}
        loop, output = self.send(loop, moves[..., 0], now, signals)
        return MpcMemory(loop, observed), output

    def _coasting(self, loop: LoopMemory, disturbance: Array, now: ControlInput) -> tuple[Array, Array]:
        """Return the errors of position and velocity at the end of each block without any move, (..., 3, MOVES)."""
        drives, model, reference = loop.predictor.drives, self._model, now.reference
        age_s = np.asarray(now.age_s)[..., None]  # (..., 1, 1) in a batch
        ahead_s = model.after_s + age_s
        p, v, d = (vector[..., None] for vector in (now.position_w_m, now.velocity_w_mps, disturbance))
        position = p + ahead_s * v + 0.5 * ahead_s * ahead_s * d + _through(model.position, drives)
        velocity = v + ahead_s * d + _through(model.velocity, drives)
        late_s = model.after_s - self.preview_s
        p, v, a = (
            vector[..., None]
            for vector in (reference.position_w_m, reference.velocity_w_mps, reference.acceleration_w_mps2)
        )
        return position - p - late_s * v - 0.5 * late_s * late_s * a, velocity - v - late_s * a

    def _bounded(self, moves: Array) -> Array:
        """Return the best moves (..., 3, MOVES) inside their bounds, from the best without bounds."""
        most = np.broadcast_to(self.gains.max_accel_mps2[..., None], moves.shape)
        outside = (np.abs(moves) > most).any(axis=-1)
        if not outside.any():
            return moves
        cost = np.broadcast_to(self._program.cost, (*moves.shape, MOVES))
        bounded = moves.copy()
        for at in zip(*np.nonzero(outside), strict=True):
            bounded[at] = self._solve(cost[at], -cost[at] @ moves[at], most[at])
        return bounded

    @cached_property
    def _solve(self) -> "Callable[[Array, Array, Array], Array]":
        return _solver()

    @cached_property
    def _model(self) -> "_Model":
        return _model(self.vehicle, self.period_s)

    @cached_property
    def _program(self) -> "_Program":
        """The condensed program; stacked where a batch of vehicles has a batch of weights."""
        g = self.gains
        weights = np.broadcast_arrays(g.velocity_s, g.command_s4, g.change_s4)
        if not weights[0].shape:
            return _condensed(self.vehicle, self.period_s, *(float(weight) for weight in weights))
        rows = zip(*(weight[..., 0].ravel().tolist() for weight in weights), strict=True)
        each = [_condensed(self.vehicle, self.period_s, *row) for row in rows]
        return _Program(*(np.stack([vars(one)[name] for one in each]) for name in _Program.__dataclass_fields__))


@dataclass(frozen=True)
class _Model:
    """Response of an axis at the end of each block, for x, y and z: to what was sent (3, MOVES, n), and to moves."""

    after_s: Array
    """Time from now to the end of each block, (MOVES,)."""
    position: Array
    velocity: Array
    moves_position: Array
    moves_velocity: Array


@dataclass(frozen=True)
class _Program:
    """Condensed program: its cost (..., 3, MOVES, MOVES), and its solution without bounds, linear in what is seen."""

    cost: Array
    of_position: Array
    of_velocity: Array
    of_feedforward: Array
    of_sent: Array

    def best(self, position: Array, velocity: Array, feedforward: Array, sent: Array) -> Array:
        """Return the moves (..., 3, MOVES) that cost least, from errors without moves (..., 3, MOVES)."""
        corrections = _through(self.of_position, position) + _through(self.of_velocity, velocity)
        return self.of_feedforward * feedforward[..., None] + self.of_sent * sent[..., None] - corrections


@lru_cache(maxsize=1024)
def _condensed(
    vehicle: VehicleModel, period_s: float, velocity_s: float, command_s4: float, change_s4: float
) -> _Program:
    model = _model(vehicle, period_s)
    of_p, of_v = (np.swapaxes(moves, -1, -2) for moves in (model.moves_position, model.moves_velocity))
    change: Array = np.eye(MOVES) - np.eye(MOVES, k=-1)
    cost = of_p @ model.moves_position + velocity_s**2 * of_v @ model.moves_velocity
    cost = cost + command_s4 * np.eye(MOVES) + change_s4 * change.T @ change
    inverse = np.asarray(np.linalg.inv(cost), dtype=np.float64)
    return _Program(
        cost,
        inverse @ of_p,
        velocity_s**2 * inverse @ of_v,
        command_s4 * inverse.sum(axis=-1),
        change_s4 * inverse[..., 0],
    )


@lru_cache(maxsize=64)
def _model(vehicle: VehicleModel, period_s: float) -> _Model:
    v = vehicle
    lag, rotors = second_order(v.attitude_bandwidth_radps, v.attitude_damping), first_order(v.thrust_lag_s)
    after_s = np.asarray(v.setpoint_delay_s + BLOCK_S * np.arange(1, MOVES + 1), dtype=np.float64)
    count = int(np.ceil((v.mocap_age_s + v.setpoint_delay_s) / period_s - 1e-9)) + 1
    across = _responses(lag, after_s + v.mocap_age_s, v.mocap_age_s + v.setpoint_delay_s, period_s, count)
    upward = _responses(rotors, after_s + v.mocap_age_s, v.mocap_age_s + v.thrust_delay_s, period_s, count)
    return _Model(after_s, *(np.stack((a, a, b)) for a, b in zip(across, upward, strict=True)))


def _responses(system: Array, at_s: Array, acts_s: float, period_s: float, count: int) -> tuple[Array, ...]:
    """Return position and velocity at times after the capture: of commands sent, acceleration and jerk, and of moves.

    A command sent k cycles ago acts from k periods before `acts_s` on, the first move from then on, the last one for
    ever.
    """
    sent = np.clip(acts_s - period_s * np.arange(count, -1, -1), 0.0, None)
    moved = np.append(acts_s + BLOCK_S * np.arange(MOVES), np.inf)
    ends = np.stack([exponential(system * at) for at in at_s])
    past = _steps(system, at_s, sent)
    new = _steps(system, at_s, moved)
    drives = [np.concatenate((past[row], ends[:, row, 2:4]), axis=-1) for row in (0, 1)]
    return drives[0], drives[1], new[0], new[1]


def _steps(system: Array, at_s: Array, edges_s: Array) -> Array:
    """Return the responses (2, times, edges - 1) of position and velocity to a unit command between two edges."""
    since = [[_since(system, at - edge) for edge in edges_s.tolist()] for at in at_s.tolist()]
    begun = np.moveaxis(np.array(since), -1, 0)
    return np.asarray(begun[..., :-1] - begun[..., 1:])


def _since(system: Array, begun_s: float) -> Array:
    """Return position and velocity after a unit command that began `begun_s` ago (s)."""
    return exponential(system * begun_s)[:2, _COMMAND] if begun_s > 0.0 else np.zeros(2)


def _through(matrices: Array, vectors: Array) -> Array:
    """Return the products (..., 3, m) of matrices (..., 3, m, n) and vectors (..., 3, n)."""
    return np.asarray(np.matmul(matrices, vectors[..., None])[..., 0])


def _solver() -> Callable[[Array, Array, Array], Array]:
    """Return the solver of min x'Hx/2 + f'x with |x| <= most; ConfigError where DAQP is not installed."""
    try:
        import daqp  # noqa: PLC0415 - the other laws fly without it
    except ImportError as error:
        raise ConfigError("law = 'mpc' needs the solver daqp, which is not installed: pip install daqp") from error
    none, free = np.zeros((0, MOVES)), np.zeros(MOVES, dtype=np.int32)

    def solve(cost: Array, slope: Array, most: Array) -> Array:
        found = daqp.solve(np.array(cost), slope, none, np.array(most), -most, free)
        return np.asarray(found[0])

    return solve
