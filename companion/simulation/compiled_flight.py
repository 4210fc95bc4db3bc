"""Flights in virtual time by the compiled loop: the same numbers as in Python, vehicle after vehicle."""

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.compiled.leaves import flat
from companion.compiled.library import library, side_by_side
from companion.control.compiled.cycle import example_law, law_of
from companion.control.controller import Controller
from companion.control.etnn import Etnn
from companion.control.horizon_correction import HorizonRules
from companion.control.network import initial_network
from companion.control.pipeline import idle_setpoint
from companion.core.types import Array
from companion.geometry.attitude import ThrustModel
from companion.geometry.frames import flip_quat
from companion.guard.limits import Limits
from companion.simulation.mission import Mission, References
from companion.simulation.traced_laws import SURROUNDINGS, WORTH_COMPILING, Surroundings, code_of
from companion.simulation.traces import carrier_of
from companion.simulation.virtual_world import STEP_S, VirtualVehicle, hover_signal, hovering, steps_of
from mock_autopilot.physics.arms import Coupling
from mock_autopilot.physics.disturbance import BLOCK, noise_of, steady_series
from mock_autopilot.physics.plant import PlantParams
from mock_autopilot.px4.attitude_error import SAMPLE_HZ, AttitudeErrorSamples, Walk

RING, ROW = 128, 11
_DOUBLES = ctypes.POINTER(ctypes.c_double)


class Flight(ctypes.Structure):
    """`struct flight` of flight.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("cycles", "steps_per_cycle")),
        *((f"{name}_delay", ctypes.c_int64) for name in ("mocap", "attitude", "thrust", "report")),
        *((name, ctypes.c_int64) for name in ("strict", "corrects")),
        *((name, ctypes.c_double) for name in ("period_s", "step_s", "first_signal", "report_age_s", "sample_hz")),
        *(("force_scale", ctypes.c_double), ("noise_keep", ctypes.c_double)),
        *(("noise_fresh", ctypes.c_double * 3), ("look_noise", ctypes.c_double * 2)),
        *((name, ctypes.c_void_p) for name in ("first_q", "first_setpoint", "airframe", "params", "law", "network")),
        *((name, ctypes.c_void_p) for name in ("rules", "carrier", "looks", "gusts")),
        ("block", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("steady", "unseen", "errors", "arms", "ahead", "known", "rows")),
    )


def fly(
    pilot: Any, vehicle: VirtualVehicle, mission: Mission, seeds: Sequence[int], progress: Callable[[int], None] | None
) -> Array | None:
    """Return what each vehicle did in each cycle, (vehicles, ROW, cycles); None where Python has to fly.

    A row is true position (m) and velocity (m/s), the command (m/s^2), and 1 at an event and where a setpoint was sent.
    A single vehicle is left to Python when a frame would not simply be accepted.
    """
    lead = mission.lead
    code = _code_of(pilot.law, pilot.thrust, pilot.limits, len(seeds))
    if isinstance(code, str) or pilot.ground is not None or not _fits(vehicle):
        return None
    flights = _Flights(code, pilot, vehicle=vehicle, mission=mission, seeds=seeds)
    rows = np.empty((len(seeds), ROW, len(mission.time_s)))
    count, _, cycles = rows.shape
    if not lead and flights.fly_one(rows[0]) < cycles:
        return None
    for begin in range(0, count, flights.width):
        end = min(begin + flights.width, count)
        if lead:
            flights.fly_together(range(begin, end), rows)
        if progress is not None:
            for cycle in range(cycles * begin // count, cycles * end // count):
                progress(cycle)
    return rows


@dataclass(frozen=True, kw_only=True)
class _Code:
    """Compiled code that flies a law, and the numbers of the law that it takes."""

    one: ctypes.CDLL
    together: ctypes.CDLL | None
    law: object
    like: object
    network: Array


def engine_of(law: Controller, vehicles: int) -> str:
    """Return in words what flies so many vehicles with a law on board."""
    code = _code_of(law, ThrustModel(), Limits(), vehicles)
    return f"in Python ({code})" if isinstance(code, str) else "compiled"


def _code_of(law: Controller, model: ThrustModel, limits: Limits, vehicles: int) -> _Code | str:
    """Return what flies a law; why it has to be Python, where it is not compiled."""
    loaded = library()
    if loaded is None:
        return "nothing is compiled here"
    if type(law) is not Etnn:
        if vehicles < WORTH_COMPILING:
            return f"a law is compiled for {WORTH_COMPILING} vehicles or more"
        traced, around = code_of(law), Surroundings(model=model, limits=limits)
        if isinstance(traced, str):
            return traced
        return _Code(one=traced, together=None, law=around, like=SURROUNDINGS, network=np.zeros(1))
    numbers = law_of(law, model, limits)
    if numbers is None:
        return "the compiled ET-NN has a prediction over few commands, and four hidden neurons"
    return _Code(
        one=loaded,
        together=side_by_side(),
        law=numbers,
        like=example_law(),
        network=np.concatenate([part.ravel() for part in vars(initial_network(law.gains)).values()]),
    )


def _fits(vehicle: VirtualVehicle) -> bool:
    delays = vehicle.mocap_delay_s, vehicle.attitude_delay_s, vehicle.thrust_delay_s, vehicle.report_delay_s
    return all(int(np.max(steps_of(delay))) < RING - 1 for delay in delays)


class _Flights:
    """Flights of a batch, or of one vehicle, with everything but their noise."""

    def __init__(
        self,
        code: _Code,
        pilot: Any,
        vehicle: VirtualVehicle,
        mission: Mission,
        seeds: Sequence[int],
    ) -> None:
        self._pilot, self._vehicle, self._lead = pilot, vehicle, mission.lead
        self._cycles, self._per_cycle = len(mission.time_s), round(pilot.period_s / STEP_S)
        self._steps = self._cycles * self._per_cycle
        self._law = self._flat(code.law, code.like)
        self._params = self._flat(pilot.estimator, pilot.estimator)
        self._rules = self._flat(pilot.horizon, HorizonRules())
        self._carrier, self._airframe = self._bodies(mission.now.position_w_m[0] + vehicle.offset_w_m)
        self._network = code.network
        self._steady = steady_series(vehicle.forces, STEP_S, self._steps)
        self._ahead = _columns(mission.ahead, self._lead)
        self._known = None if pilot.feedforward_b_mps2 is None else _each(pilot.feedforward_b_mps2)
        table = None if vehicle.arms is None else vehicle.arms.table
        self._arms = None
        if table is not None:
            columns = (table.moment, table.momentum, table.force, table.torque)
            self._arms = np.ascontiguousarray(np.concatenate([column[: self._steps] for column in columns], axis=-1))
        self._yaw_rad = np.broadcast_to(mission.now.yaw_rad[0], self._lead or (1,))
        self._loaded, self._batch = code.one, code.together
        self._generators(seeds, code.one)
        self._signal = hover_signal(vehicle.plant, self._lead)
        self.width = 1 if self._batch is None or not self._lead else int(self._batch.width())
        """Vehicles that fly side by side."""
        self._looks = np.empty((self.width, self._cycles, 6))
        self._gusts = np.empty((self.width, -(-self._steps // BLOCK) * BLOCK, 3))
        hover = pilot.thrust.hover_thrust
        first = [idle_setpoint(float(yaw_rad), hover) for yaw_rad in self._yaw_rad]
        self._first = np.array([(*each.q_w_flu_wxyz.tolist(), float(each.thrust)) for each in first])
        self._unseen = None if vehicle.unseen is None else np.array(vehicle.unseen.T, np.uint8, order="C", ndmin=2)

    def _generators(self, seeds: Sequence[int], loaded: ctypes.CDLL) -> None:
        """Every vehicle's own random numbers, as VirtualWorld draws them."""
        children = [np.random.SeedSequence(seed).spawn(3) for seed in seeds]
        self._rngs = [(np.random.default_rng(eye), np.random.default_rng(force)) for eye, force, _ in children]
        self._errors = None
        if self._vehicle.attitude_error.present:
            rngs = [np.random.default_rng(horizon) for _, _, horizon in children]
            samples = AttitudeErrorSamples(self._vehicle.attitude_error, rngs, (len(seeds),))
            count = int(self._steps * STEP_S * SAMPLE_HZ) + 3
            walk = samples.walk(count)
            if walk is None:
                self._errors = np.ascontiguousarray(np.swapaxes(samples.more(count), 0, 1))
            else:
                self._errors = _walked(walk, loaded)

    def _flat(self, value: object, like: object) -> Array:
        """Return all numbers of a value as a row for each vehicle, (vehicles or 1, n)."""
        return flat(value, like, self._lead)

    def _bodies(self, start_w_m: Array) -> tuple[Array, Array]:
        v, lead = self._vehicle, self._lead
        inertia, trim_s, trimmed = np.ones(3), np.ones(3), np.zeros((*lead, 3))
        if v.arms is not None:
            inertia, trim_s = np.array(v.arms.inertia_kgm2), np.array(v.arms.trim_s)
            coupling = Coupling(v.arms.table.first, v.plant.mass_kg, v.arms.inertia_kgm2, v.arms.trim_s)
            trimmed = np.stack(np.broadcast_arrays(*coupling._trimmed), axis=-1)
        carrier = carrier_of(v.plant, inertia, trim_s, lead)
        s = hovering(start_w_m, v.plant)
        state = (s.position_ned_m, s.velocity_ned_mps, s.q_ned_frd_wxyz, s.rate_frd_radps, s.thrust_n[..., None])
        more = (s.acceleration_ned_mps2, 1.0 * s.on_ground[..., None], s.turn_frd_radps2, np.zeros((*lead, 3)), trimmed)
        columns = [np.broadcast_to(part, (*lead, part.shape[-1])) for part in state + more]
        self._first_q = np.ascontiguousarray(flip_quat(s.q_ned_frd_wxyz)).reshape(-1, 4)
        example = carrier_of(PlantParams(), np.zeros(3), np.zeros(3), ())
        return self._flat(carrier, example), np.concatenate(columns, axis=-1).reshape(-1, 27)

    def fly_one(self, rows: Array) -> int:
        """Fly the only vehicle; return the number of cycles until a frame was not simply accepted."""
        return int(self._loaded.fly_vehicle(ctypes.byref(self._prepared(0, 0, rows, strict=True))))

    def fly_together(self, indices: range, rows: Array) -> None:
        """Fly up to `width` vehicles of the batch."""
        prepared = [self._prepared(index, slot, rows[index], strict=False) for slot, index in enumerate(indices)]
        if self._batch is None:
            self._loaded.fly_vehicle(ctypes.byref(prepared[0]))
        else:
            self._batch.fly_vehicles((Flight * len(prepared))(*prepared), ctypes.c_int64(len(prepared)))

    def _prepared(self, index: int, slot: int, rows: Array, *, strict: bool) -> Flight:
        """Return the flight of one vehicle, whose noise is drawn now into the buffers of a slot."""
        v, pilot = self._vehicle, self._pilot
        eye, force = self._rngs[index]
        eye.standard_normal(out=self._looks[slot])
        for block in self._gusts[slot].reshape(-1, BLOCK, 3):
            force.standard_normal(out=block)
        keep, fresh = noise_of(v.forces, STEP_S)

        def one(each: Any) -> Any:
            return np.broadcast_to(np.asarray(each), self._lead or (1,))[index].item()

        def row(table: NDArray[Any]) -> int:
            return int(table[index if len(table) > 1 else 0].ctypes.data)

        def address(array: NDArray[Any] | None) -> int | None:
            return None if array is None else array.ctypes.data

        return Flight(
            cycles=self._cycles,
            steps_per_cycle=self._per_cycle,
            mocap_delay=one(steps_of(v.mocap_delay_s)),
            attitude_delay=one(steps_of(v.attitude_delay_s)),
            thrust_delay=one(steps_of(v.thrust_delay_s)),
            report_delay=one(steps_of(v.report_delay_s)),
            strict=strict,
            corrects=pilot.horizon.enabled,
            period_s=pilot.period_s,
            step_s=STEP_S,
            first_signal=one(self._signal),
            report_age_s=one(steps_of(v.report_delay_s) * STEP_S),
            sample_hz=SAMPLE_HZ,
            force_scale=one(v.force_scale),
            noise_keep=keep,
            noise_fresh=tuple(fresh.tolist()),
            look_noise=(one(v.noise_m), one(v.noise_rad)),
            first_q=row(self._first_q),
            first_setpoint=row(self._first),
            airframe=row(self._airframe),
            params=row(self._params),
            law=row(self._law),
            network=address(self._network),
            rules=row(self._rules),
            carrier=row(self._carrier),
            looks=address(self._looks[slot]),
            gusts=address(self._gusts[slot]),
            block=BLOCK,
            steady=address(self._steady),
            unseen=None if self._unseen is None else row(self._unseen),
            errors=None if self._errors is None else row(self._errors),
            arms=address(self._arms),
            ahead=row(self._ahead),
            known=None if self._known is None else row(self._known),
            rows=address(rows),
        )


def _walked(walk: Walk, loaded: ctypes.CDLL) -> Array:
    """Return the errors of each vehicle's horizon (rad), (vehicles, samples, 2)."""
    errors = np.empty_like(walk.draws)
    for rows, first, keep, fresh, draws in zip(errors, walk.first, walk.keep, walk.fresh, walk.draws, strict=True):
        ends = (ctypes.c_double(keep), ctypes.c_double(fresh))
        addresses = (ctypes.c_void_p(array.ctypes.data) for array in (rows, first, draws))
        place, begin, drawn = addresses
        loaded.walk(place, ctypes.c_int64(len(rows)), *ends, begin, drawn)
    return errors


def _columns(references: References, lead: tuple[int, ...]) -> Array:
    """Return position, velocity, acceleration and heading in each cycle, (vehicles or 1, cycles, 10)."""
    vectors = (references.position_w_m, references.velocity_w_mps, references.acceleration_w_mps2)
    same = not lead or all(column.strides[1] == 0 for column in (*vectors, references.yaw_rad))
    parts = [*vectors, references.yaw_rad[..., None]]
    if lead and same:
        parts = [part[:, 0] for part in parts]
    together = np.concatenate(parts, axis=-1)
    return together[None] if same else np.ascontiguousarray(np.moveaxis(together, 1, 0))


def _each(series: Array) -> Array:
    """Return a series (cycles, 3), or one for each vehicle, (cycles, vehicles, 3), as (1 or vehicles, cycles, 3)."""
    return series[None] if series.ndim == 2 else np.ascontiguousarray(np.moveaxis(series, 1, 0))
