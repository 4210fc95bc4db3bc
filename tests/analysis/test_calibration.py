"""Calibration of recorded virtual flights comes out at the mock's truth, or says that it cannot."""

import asyncio
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from companion.analysis.calibration.attitude import fit_attitude, response
from companion.analysis.calibration.calibration import Calibrated, Finding, calibrate
from companion.analysis.calibration.signals import observed, smooth_held, without_waiting
from companion.analysis.report.recorded_flight import Flown
from companion.cli.commands import app
from companion.config.companion_config import CompanionConfig
from companion.flight.tick import Tick
from companion.ground.ground_record import tick_of
from companion.records.errors import UnfitFlightError
from companion.records.flight_record import FlightRecord
from companion.records.read import RecordError, read_flight
from companion.records.split.merge import merge
from companion.supervisor.flight_state import Phase, TrackRequest
from companion.trajectories.waypoints import Waypoints
from mock_autopilot.physics.plant import Wrench
from mock_autopilot.world import STEP_S
from tests.analysis.recorded import recorded
from tests.flights.simulated import BRISK, Flight, Step, fly
from tests.flights.simulated_ground import GroundSetup, ground_config
from tests.flights.test_simulated_flights import UP, ask, until, wait
from tests.mock_autopilot.bench import PERFECT

pytestmark = pytest.mark.slow

HOVER_S = 14.0
WEIGHT_N = 4.85 * 9.80665
HEIGHTS_M = (1.2, 1.9, 0.9, 1.9, 0.9, 1.9, 0.9)
CLIMBS = Waypoints(
    2.5 * np.arange(len(HEIGHTS_M), dtype=np.float64),
    np.array([[0.0, 0.0, height] for height in HEIGHTS_M]),
    np.zeros(len(HEIGHTS_M)),
)
ON_GROUND = ground_config(CompanionConfig(flight=BRISK), onboard_mocap=True)
RADIO, RADIO_S = "delay 4 ms", 0.004
TICK_S = 0.002
"""The mock's: how late its own loops see a setpoint, and how old the attitude is that it tells."""


def _pushed(steps: list[Step]) -> list[Step]:
    """The room of config/mock.toml pushes: constant, slow waves, and noise."""
    chance, noise = np.random.default_rng(3), np.zeros(3)

    def push(flight: Flight) -> None:
        t = flight.room.now_s()
        noise[:] += -0.01 * noise + 0.2 * math.sqrt(0.02) * chance.normal(size=3)
        waves = [1.4 * math.sin(t / 9.0 * math.tau), 1.1 * math.sin(t / 13.0 * math.tau), 0.8 * math.sin(t / 2.7)]
        force = np.array([0.4, -0.3, 0.0]) + waves + noise
        flight.room.bench.world.external_wrench = Wrench(force, np.zeros(3))

    def with_push(step: Step) -> Step:
        def pushed(flight: Flight) -> bool:
            push(flight)
            return step(flight)

        return pushed

    return [with_push(step) for step in steps]


def _fly(folder: Path, **how: Any) -> tuple[Flown, list[Tick]]:
    script = [*UP, wait(HOVER_S), ask(TrackRequest(CLIMBS, 1.0)), until(Phase.TRACK), until(Phase.HOLD), wait(2.0)]
    # Hovers and climbs tilt the vehicle less than its horizon wanders: then the attitude's answer is not found.
    flight = asyncio.run(fly(_pushed(script), estimator=PERFECT, step_s=STEP_S, **how))
    return Flown(read_flight(recorded(flight.ticks, folder))), flight.ticks


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> tuple[Flown, list[Tick]]:
    """Return the configuration of the demo's vehicle."""
    return _fly(tmp_path_factory.mktemp("usual"))


@pytest.fixture(scope="module")
def split(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlightRecord, FlightRecord]:
    """Return the vehicle's record of a hover by a law on the ground, alone and merged with the ground's."""
    folder = tmp_path_factory.mktemp("split")
    hover = _pushed([*UP, wait(HOVER_S)])
    flight = asyncio.run(fly(hover, estimator=PERFECT, config=ON_GROUND, ground=GroundSetup(link=RADIO), step_s=STEP_S))
    assert flight.ground is not None
    vehicle = recorded(flight.ticks, folder / "vehicle", ON_GROUND)
    ground = recorded(map(tick_of, flight.ground.ground.ticks), folder / "ground", ON_GROUND, side="ground")
    merge(vehicle, ground, folder / "merged.mcap")
    return read_flight(vehicle), read_flight(folder / "merged.mcap")


def found(flown: Flown) -> dict[str, Finding]:
    return {finding.name: finding for finding in calibrate(observed(flown), CompanionConfig()).findings}


def near(finding: Finding, truth: float, within: float) -> bool:
    """Within the tolerance, and within what the calibration itself says of its uncertainty."""
    return abs(finding.value - truth) < within and abs(finding.value - truth) < 3.5 * finding.sd


def test_the_demos_vehicle(usual: tuple[Flown, list[Tick]]) -> None:
    values = found(usual[0])
    assert near(values["vehicle.hover_thrust"], WEIGHT_N / 95.1, 0.01)
    assert near(values["vehicle.thrust_curve"], 0.0, 0.1)
    assert near(values["vehicle.thrust_lag_s"], 0.05 + 0.004 + TICK_S - 0.01, 0.012)
    assert near(values["mocap.delay_s"], 0.008 - TICK_S, 0.003)


def test_the_attitude_answers_as_the_mock_does(usual: tuple[Flown, list[Tick]]) -> None:
    """Its loop is of third order with a delay: in the band of a flight the two answer alike.

    At 1 Hz the fitted loop of second order answers by 5.5 to 6.5 % more (three seeds), as the law excites it.
    """
    values = found(usual[0])
    delay_s, bandwidth, damping = (
        values[f"vehicle.{key}"].value for key in ("setpoint_delay_s", "attitude_bandwidth_radps", "attitude_damping")
    )
    delay_s += values["mocap.delay_s"].value - 0.008  # all of what mocap's delay is wrong by is in the setpoint's
    for hertz in (0.2, 0.5, 1.0):
        s = 1j * math.tau * hertz
        ours = bandwidth**2 / (s**2 + 2.0 * damping * bandwidth * s + bandwidth**2) * np.exp(-s * delay_s)
        w, z, lag_s = 7.2, 0.92, 0.05
        theirs = w**2 / (s**2 * (1.0 + lag_s * s) + 2.0 * z * w * s + w**2) * np.exp(-s * (0.014 + TICK_S))
        assert abs(ours) == pytest.approx(abs(theirs), rel=0.08)
        assert abs(np.angle(ours / theirs)) / (math.tau * hertz) < 0.02  # of 0.27 s


def test_another_vehicle_in_another_room(tmp_path: Path) -> None:
    """Motors with a curve, slower rotors, an attitude loop of second order, and slower motion capture."""
    plant = {
        "motor_curve": 0.3, "max_thrust_n": 110.0, "thrust_lag_s": 0.08,
        "torque_lag_s": (0.0, 0.0, 0.0), "attitude_bandwidth_radps": (6.0, 6.0, 2.7),
    }  # fmt: skip
    values = found(_fly(tmp_path, plant=plant, mocap={"delay_s": 0.02})[0])
    share = WEIGHT_N / 110.0
    hover = (-0.7 + math.sqrt(0.49 + 1.2 * share)) / 0.6  # 0.3 t^2 + 0.7 t = share
    assert near(values["vehicle.hover_thrust"], hover, 0.01)
    assert near(values["vehicle.thrust_curve"], 0.3, 0.1)
    assert near(values["vehicle.thrust_lag_s"], 0.08 + 0.004 + TICK_S - 0.01, 0.015)
    assert near(values["vehicle.attitude_bandwidth_radps"], 6.0, 0.25)
    assert near(values["vehicle.attitude_damping"], 0.92, 0.05)
    assert abs(values["vehicle.setpoint_delay_s"].value - (0.014 + 2.0 * TICK_S)) < 0.005
    assert near(values["mocap.delay_s"], 0.02 - TICK_S, 0.003)


def _without_frames(record: FlightRecord) -> Flown:
    """Return the flight as it would be recorded by a vehicle that no frames reach."""
    law = record.metadata["config"]["law"] | {"onboard_mocap": False}
    columns = {name: column for name, column in record.columns.items() if not name.startswith("frame_")}
    config = record.metadata["config"] | {"law": law}
    return Flown(replace(record, columns=columns, metadata=record.metadata | {"config": config}))


def test_a_law_on_the_ground_adds_nothing_to_the_delays(
    usual: tuple[Flown, list[Tick]], split: tuple[FlightRecord, FlightRecord]
) -> None:
    hovering = _cut(usual[0], lambda flown: (flown.time_s > 4.5) & (flown.time_s < 18.5))
    on_board, values = found(hovering), found(Flown(split[0]))
    assert near(values["vehicle.hover_thrust"], WEIGHT_N / 95.1, 0.01)
    assert near(values["mocap.delay_s"], 0.008 - TICK_S, 0.003)
    assert values["mocap.delay_s"].says.endswith("; of the vehicle's frames")
    delays_s = [one["vehicle.setpoint_delay_s"].value + one["mocap.delay_s"].value for one in (on_board, values)]
    assert delays_s[1] == pytest.approx(delays_s[0], abs=0.008)
    assert near(values["law.link.delay_s"], RADIO_S, 0.001)
    assert "law.link.delay_s" not in on_board
    (line,) = re.findall(r"\[law\.link\]\ndelay_s = .*", calibrate(observed(Flown(split[0])), ON_GROUND).toml())
    assert line.endswith("= 0.004")


def test_without_frames_on_the_vehicle_the_grounds_are_taken(split: tuple[FlightRecord, FlightRecord]) -> None:
    values = found(_without_frames(split[1]))
    assert near(values["mocap.delay_s"], 0.008 - TICK_S, 0.003)
    assert values["mocap.delay_s"].says.endswith("; of the ground's frames")
    assert near(values["vehicle.hover_thrust"], WEIGHT_N / 95.1, 0.01)
    with pytest.raises(UnfitFlightError, match=r"no frames reached the vehicle .* `companion records merge`"):
        observed(_without_frames(split[0]))
    assert split[1].ground is not None
    with pytest.raises(UnfitFlightError, match="is the record of a law on the ground: give the vehicle's"):
        observed(Flown(split[1].ground))


def _cut(flown: Flown, wanted: Callable[[Flown], Any]) -> Flown:
    """The flight from lift-off, and then only what is wanted."""
    rows = (flown.time_s < 0.2) | wanted(flown)
    return Flown(replace(flown.record, columns={name: column[rows] for name, column in flown.record.columns.items()}))


def test_a_hover_alone_does_not_show_the_rotors(usual: tuple[Flown, list[Tick]]) -> None:
    hovering = _cut(usual[0], lambda flown: (flown.time_s > 4.5) & (flown.time_s < 18.5))
    shown = calibrate(observed(hovering), CompanionConfig())
    left = {one.name: one.why for one in shown.left}
    assert "climbs and descents" in left["vehicle.thrust_curve"]
    assert "climbs and descents" in left["vehicle.thrust_lag_s"]
    assert "hover_thrust" in shown.toml()
    assert "thrust_curve" not in shown.toml()


def test_climbs_alone_do_not_show_the_hover_thrust(usual: tuple[Flown, list[Tick]]) -> None:
    climbing = _cut(usual[0], lambda flown: flown.tracked)
    shown = calibrate(observed(climbing), CompanionConfig())
    assert "hovered for less than" in {one.name: one.why for one in shown.left}["vehicle.hover_thrust"]


def test_an_attitude_that_does_not_follow_is_no_attitude_loop(usual: tuple[Flown, list[Tick]]) -> None:
    seen = observed(usual[0])
    elsewhere = replace(seen, up_w=np.roll(seen.up_w, 700, axis=0))
    assert fit_attitude(elsewhere).explained < 0.5
    shown = calibrate(elsewhere, CompanionConfig())
    assert {"vehicle.attitude_bandwidth_radps", "mocap.delay_s"} <= {one.name for one in shown.left}


def test_a_flight_near_the_ground_is_refused(usual: tuple[Flown, list[Tick]]) -> None:
    start = _cut(usual[0], lambda flown: flown.time_s < 2.0)
    with pytest.raises(RecordError, match="hover for at least half a minute"):
        observed(start)


def test_arms_that_never_rest_are_refused(usual: tuple[Flown, list[Tick]]) -> None:
    record = usual[0].record
    waving = np.full((len(record.columns["time_s"]), 8), 0.5)
    with pytest.raises(RecordError, match="arms stowed"):
        observed(Flown(replace(record, columns=record.columns | {"joint_goal_velocity_radps": waving})))


def test_the_command_prints_lines_for_the_configuration(usual: tuple[Flown, list[Tick]]) -> None:
    path = str(usual[0].record.path)
    said = CliRunner().invoke(app, ["calibrate", path])
    assert said.exit_code == 0
    assert "[vehicle]\nhover_thrust = 0.5" in said.stdout
    numbers = json.loads(CliRunner().invoke(app, ["calibrate", path, "--json"]).stdout)
    values: Calibrated = calibrate(observed(usual[0]), CompanionConfig())
    assert numbers["found"]["vehicle.hover_thrust"]["value"] == values.findings[0].value
    assert numbers["toml"] == values.toml()


def test_a_setpoint_between_two_grid_points_keeps_its_instant() -> None:
    grid_s = np.arange(0.0, 1.0, 0.1)
    values = smooth_held(grid_s, np.array([0.0, 0.53]), np.array([[0.0], [1.0]]))[:, 0]
    assert values.tolist() == pytest.approx([0.0] * 5 + [0.7, *[1.0] * 4])


def test_arrivals_without_waiting_are_the_quickest_of_the_last_seconds() -> None:
    stamp_s = np.arange(0.0, 30.0, 0.1)
    slow = np.where(np.arange(len(stamp_s)) % 7 == 0, 0.0, 0.02)
    clocks_s = 100.0 + 1e-4 * stamp_s  # they drift
    ideal = without_waiting(stamp_s, stamp_s + clocks_s + slow)
    assert np.abs(ideal - stamp_s - clocks_s).max() < 1.1e-3 + 0.02 * (stamp_s < 0.1).max()
    assert np.abs((ideal - stamp_s - clocks_s)[10:]).max() < 1.1e-3


@pytest.mark.parametrize("damping", [0.4, 1.0, 1.7])
def test_the_impulse_response_has_the_area_one(damping: float) -> None:
    t = np.arange(0.0, 20.0, 0.001)
    assert float(response(t, 7.0, damping).sum() * 0.001) == pytest.approx(1.0, abs=1e-3)
