"""A Monte Carlo sweep: which vehicles fly side by side, and a row of numbers for each. Pure; `sweep_run` runs it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.config.controller_config import LoadedController
from companion.control.law_check import in_flight
from companion.simulation.link_numbers import link_numbers
from companion.simulation.metrics import score
from companion.simulation.mission import stacked
from companion.simulation.scene import Scene
from companion.simulation.simulation import Pilot, Trace, simulate
from companion.simulation.virtual_record import one_of
from companion.simulation.virtual_world import VirtualVehicle
from companion.studies.sweep.sweep_vehicles import Drawn, draw, radios, vehicles

Columns = dict[str, NDArray[Any]]
"""A table, one row a vehicle: each column (N, ...)."""

ERROR = "error_whole_m"
"""The column that counts as a vehicle's error: norm of the three axes' means over the whole flight, offset included."""


@dataclass(frozen=True)
class Batch:
    """Vehicles that fly side by side."""

    seed: int
    controller: str
    """Name or file."""
    experiment: str
    """Name or file."""
    nominal_radps: float
    """Attitude bandwidth that the companion is configured for."""
    indices: range
    """Indices of the vehicles in the sweep."""
    link: str | None = None
    """Radio to a law on the ground, as a sentence, `clean` for a perfect one; None: the law is on board."""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Description of a sweep: vehicles, seed, controller."""

    vehicles: int
    seed: int
    controller: str
    experiments: tuple[str, ...] = ("ellipse", "figure8")
    nominals_radps: tuple[float, ...] = (12.0, 6.3)
    batch_size: int = 250
    """250 vehicles take a fifth less time side by side than in two batches, and half a gigabyte."""
    link: str | None = None
    """Radio to a law on the ground, around which each vehicle's is drawn; None: the law is on board."""

    @property
    def kinds(self) -> list[tuple[str, float]]:
        """Experiments and nominal bandwidths, as vehicle after vehicle takes turns at them."""
        return [(experiment, nominal) for experiment in self.experiments for nominal in self.nominals_radps]

    def batches(self) -> list[Batch]:
        """All of it; a longer sweep has the same full batches and more of them."""
        kinds, size = self.kinds, self.batch_size
        return [
            Batch(self.seed, self.controller, *kinds[kind], own[begin : begin + size], self.link)
            for kind in range(len(kinds))
            for own in [range(kind, self.vehicles, len(kinds))]
            for begin in range(0, len(own), size)
        ]


def fly(
    batch: Batch, scene: Scene, controller: LoadedController, progress: Callable[[int], None] | None = None
) -> Columns:
    """Every vehicle of the batch: what was drawn, and how well it flew.

    `scene` and `controller` are the batch's, for its nominal bandwidth. `progress` is told of each cycle.
    """
    drawn = draw(batch.seed, batch.indices)
    mission = stacked([scene.mission(controller.law.preview_s)] * len(batch.indices))
    true = vehicles(scene, drawn, len(mission.time_s))
    with in_flight(controller.own_file):
        trace = simulate(_pilot(scene, controller, drawn), true, mission, drawn.flight_seed.tolist(), progress=progress)
    return _parameters(batch, drawn, true, scene) | results(trace) | _link(trace, scene, drawn)


def _pilot(scene: Scene, controller: LoadedController, drawn: Drawn) -> Pilot:
    pilot = scene.pilot(controller)
    if scene.radio is None or pilot.ground is None:
        return pilot
    return replace(pilot, ground=replace(pilot.ground, links=radios(scene.radio, drawn)))


def _link(trace: Trace, scene: Scene, drawn: Drawn) -> Columns:
    """Return each vehicle's radio and what its link carried over the trajectory; nothing for a law on board."""
    if scene.radio is None:
        return {}
    ups = [one.up for one in radios(scene.radio, drawn)]
    numbers = [link_numbers([one_of(trace, row)], scene.period_s) for row in range(len(ups))]
    return {
        "link_loss_share": np.array([one.loss_share + one.burst_share for one in ups]),
        "link_delay_s": np.array([one.delay_s for one in ups]),
        "link_jitter_s": np.array([one.jitter_s for one in ups]),
        "link_bytes_per_s": np.array([one.uplink_bytes_per_s for one in numbers if one is not None]),
        "link_messages_per_s": np.array([one.messages_per_s for one in numbers if one is not None]),
        "landed": score(trace).landed,
    }


def _parameters(batch: Batch, drawn: Drawn, true: VirtualVehicle, scene: Scene) -> Columns:
    count = len(batch.indices)
    assert true.unseen is not None
    return {
        "vehicle": np.array(batch.indices),
        "experiment": np.full(count, scene.name),
        "nominal_radps": np.full(count, batch.nominal_radps),
        "flight_seed": drawn.flight_seed,
        "mass_kg": np.asarray(true.plant.mass_kg),
        "hover_thrust": scene.companion.vehicle.hover_thrust * drawn.hover_share,
        "bandwidth_radps": batch.nominal_radps * drawn.bandwidth_share,
        "mocap_delay_s": drawn.mocap_delay_s,
        "setpoint_delay_s": drawn.setpoint_delay_s,
        "disturbance_scale": drawn.disturbance_scale,
        "noise_scale": drawn.noise_scale,
        "attitude_error_rad": drawn.attitude_error_rad * true.attitude_error.present,
        "attitude_error_time_s": drawn.attitude_error_time_s,
        "offset_w_m": true.offset_w_m,
        "offset_m": np.sqrt((true.offset_w_m**2).sum(axis=-1)),
        "flight_s": np.full(count, len(true.unseen) * scene.period_s),
        "unseen_s": true.unseen.sum(axis=0) * scene.period_s,
    }


def results(trace: Trace) -> Columns:
    """Return columns for each vehicle of a flight: errors (m), share of cycles with an update, divergence."""
    whole, flown = score(trace, float(trace.time_s[0])), score(trace)
    return {
        "error_whole_m": whole.error_m,
        "error_trajectory_m": flown.error_m,
        "mean_error_m": whole.mean_error_m,
        "max_error_m": whole.max_error_m,
        "max_trajectory_error_m": flown.max_error_m,
        "update_share": flown.update_share,
        "event_share": flown.event_share,
        "diverged": whole.diverged,
    }


def joined(parts: Sequence[Columns]) -> Columns:
    """Parts of one sweep as one table, in the vehicles' order."""
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(whole["vehicle"])
    return {name: column[order] for name, column in whole.items()}
