"""One vehicle of a campaign looked at closely: what its law thought, and what the proof says of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from companion.control.etnn import Etnn, continuous_control
from companion.control.gains import EtnnGains
from companion.control.law_check import in_flight
from companion.core.types import Array
from companion.geometry.frames import flip_yz
from companion.simulation.metrics import score
from companion.simulation.scene import Scene
from companion.simulation.simulation import Trace, simulate
from companion.simulation.virtual_world import STEP_S, VirtualVehicle, VirtualWorld
from companion.studies.paper.campaign import Item, Job, controller_of, job_of, tracking
from companion.studies.theory.fixed_time import FixedTimeBound, fixed_time_bound
from companion.studies.theory.lyapunov import Lyapunov, fit_ideal_output_weights, lyapunov_of, measured_bounds
from mock_autopilot.physics.plant import PlantParams, friction_ned_n

_OMEGA = 0.5
"""omega of eq. T_bound: halves between the ball's size and the time to it."""


@dataclass(frozen=True)
class Proof:
    """Values of the paper's theorem for one flight."""

    lyapunov: Lyapunov
    bound: FixedTimeBound
    delta_mps2: float
    """The largest that the proof has to count as Delta; infinite for a law that predicts, where nothing bounds it."""
    lipschitz_per_s: float


@dataclass(frozen=True)
class Detail:
    """The flight of an item's first seed, alone; n cycles."""

    item: Item
    trace: Trace
    mass_kg: float
    friction_w_mps2: Array
    """f_d = f(p_d'), (n, 3): what the network is meant to learn."""
    room_w_mps2: Array
    """The room's pushes, (n, 3): what it can learn as well, as far as they are slow."""
    proof: Proof | None
    """None for a law that is not the paper's, and for a vehicle that was lost: then nothing was bounded."""

    @property
    def lost(self) -> bool:
        """True if the vehicle was lost."""
        return is_lost(self.trace)

    @property
    def signals(self) -> Mapping[str, Array]:
        """The law's internal signals, by name."""
        return self.trace.signals


def look_closely(item: Item) -> Detail:
    """Fly an item's first seed alone and keep everything."""
    return look_at_job(job_of(item))


def look_at_job(job: Job) -> Detail:
    """Fly the first seed of a job's item alone and keep everything."""
    item, scene, loaded = job.item, job.scene, controller_of(job)
    law = loaded.law
    mission, vehicle, seed = scene.mission(law.preview_s), scene.vehicle(), item.seeds[0]
    with in_flight(loaded.own_file):
        trace = simulate(scene.pilot(loaded, item.feedforward), vehicle, mission, [seed], keep_signals=True)
    plant, mass_kg = vehicle.plant, float(vehicle.plant.mass_kg)
    friction = friction_w_mps2(trace.reference_velocity_w_mps, plant)
    room = _room_w_mps2(scene, vehicle, trace, seed)
    proof = _proof(law, trace, friction, plant, scene.period_s) if isinstance(law, Etnn) else None
    return Detail(item, trace, mass_kg, friction, room, proof)


def friction_w_mps2(velocity_w_mps: Array, plant: PlantParams) -> Array:
    """f of eq. mod at a velocity (..., 3) in W: the friction as an acceleration of the vehicle, in W."""
    velocity_ned = flip_yz(velocity_w_mps)
    force_ned_n = friction_ned_n(velocity_ned, plant.coefficients(STEP_S, velocity_ned.shape))
    return np.asarray(flip_yz(force_ned_n) / plant.mass_kg)


def _room_w_mps2(scene: Scene, vehicle: VirtualVehicle, trace: Trace, seed: int) -> Array:
    """The disturbance of each cycle: drawn again from the flight's seed."""
    count = len(trace.time_s)
    world = VirtualWorld(vehicle, trace.reference_w_m[0], [seed], count, scene.period_s)
    each_cycle = world.force_ned_n.reshape(count, -1, 3).mean(axis=1)
    return np.asarray(flip_yz(each_cycle) / vehicle.plant.mass_kg)


def is_lost(trace: Trace) -> bool:
    """Return true if a flight of one vehicle diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(score(trace).diverged)


def _proof(law: Etnn, trace: Trace, friction: Array, plant: PlantParams, period_s: float) -> Proof | None:
    """V along the flight, and the theorem with the bounds that were kept while the trajectory was flown."""
    gains, predicts = law.gains, law.predictor is not None
    if is_lost(trace):
        return None
    now = tracking(trace)
    wanted, signals = trace.reference_velocity_w_mps, trace.signals
    ideal = fit_ideal_output_weights(signals["v0"][-1], wanted, friction, gains)
    delta = math.inf if predicts else _largest_norm(delta_w_mps2(trace, gains, plant, period_s)[now[1:]])
    lipschitz = _steepest_per_s(plant, max(map(_largest_norm, (trace.velocity_w_mps[now], wanted))))
    kept = {name: values[now] for name, values in signals.items()}
    bounds = measured_bounds(kept, wanted[now], delta_mps2=delta, lipschitz_per_s=lipschitz, ideal=ideal)
    bound = fixed_time_bound(gains, bounds, _OMEGA, predicts)
    return Proof(lyapunov_of(signals, gains, ideal), bound, delta, lipschitz)


def _largest_norm(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1)).max())


def delta_w_mps2(trace: Trace, gains: EtnnGains, plant: PlantParams, period_s: float) -> Array:
    """Delta of eq. mod as the proof has to count it, (n-1, 3): v' - f(v) - u - known, of a law without prediction.

    u is what the law asked for, so the lag and the delays of the attitude and the rotors count as disturbance, and so
    does the dry friction's S = f(p') - f(p_d'). `known` is what the law is told of the arms: eq. ETC-law less `known`
    is its command, so Delta less `known` stands where the proof has Delta (docs/control.md).
    """
    smooth = replace(plant, coulomb_n=(0.0, 0.0, 0.0))
    wanted = trace.reference_velocity_w_mps
    dry_wanted = friction_w_mps2(wanted, plant) - friction_w_mps2(wanted, smooth)
    friction = friction_w_mps2(trace.velocity_w_mps, smooth) + dry_wanted
    own = trace.signals
    told = continuous_control(own["alpha2"], own["y2"], own["kappa"], gains) - own["u_bar"]
    moved = np.diff(trace.velocity_w_mps, axis=0) / period_s
    return np.asarray(moved - (trace.accel_w_mps2 + told + friction)[:-1])


def _steepest_per_s(plant: PlantParams, fastest_mps: float) -> float:
    """L_f of eq. f-Lip for the smooth friction up to a speed: |d(q |v| v)/dv| is 2 q |v|."""
    viscous, quadratic = (float(np.max(some)) for some in (plant.viscous_npm, plant.quadratic_npm2))
    return (viscous + 2.0 * quadratic * fastest_mps) / float(plant.mass_kg)


@dataclass(frozen=True)
class Learnt:
    """Return the share that a signal explains: 1 - |it - signal|^2 / |it|^2, per axis (3,); NaN of zero."""

    of_friction: Array
    of_friction_and_room: Array
    size_mps2: Array
    """The signal's root mean square, (3,)."""


def learnt(detail: Detail, signal: str = "f_hat") -> Learnt:
    """Return the share that the network, or another of the `signals`, explains in the trajectory's second half."""
    time_s, seen = detail.trace.time_s, detail.signals[signal]
    late = time_s >= 0.5 * time_s[-1]
    total = detail.friction_w_mps2 + detail.room_w_mps2

    def taken(of: Array) -> Array:
        square = (of[late] ** 2).sum(axis=0)
        left = ((of - seen)[late] ** 2).sum(axis=0)
        return np.where(square > 1e-12, 1.0 - left / np.maximum(square, 1e-12), np.nan)

    return Learnt(taken(detail.friction_w_mps2), taken(total), np.sqrt((seen[late] ** 2).mean(axis=0)))
