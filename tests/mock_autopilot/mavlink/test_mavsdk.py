"""MAVSDK 4 against the mock: what a program written for PX4 sees."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionError, ActionResult
from mavsdk.plugins.offboard import Attitude, Offboard, OffboardError, OffboardResult
from mavsdk.plugins.param import Param, ParamError, ParamResult
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry
from mavsdk.system import System

from tests.mock_autopilot.process import Mock, running

pytestmark = pytest.mark.realtime
ROOT = Path(__file__).parents[3]
NO_GPS = tuple(
    part
    for setting in ("EKF2_GPS_CTRL=0", "EKF2_EV_CTRL=15", "EKF2_HGT_REF=3", "EKF2_MAG_TYPE=5", "COM_OBL_RC_ACT=4")
    for part in ("--param", setting)
)


def _wait(reached: Callable[[], bool], what: str, at_most_s: float = 20.0) -> None:
    until = time.monotonic() + at_most_s
    while not reached():
        assert time.monotonic() < until, f"never: {what}"
        time.sleep(0.02)


class Pilot:
    """A MAVSDK client of one mock."""

    def __init__(self, mock: Mock) -> None:
        self.mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        self.mavsdk.add_any_connection(f"udpin://127.0.0.1:{mock.client_port}")
        found: System | None = self.mavsdk.first_autopilot(20.0)
        assert found is not None, "MAVSDK heard no autopilot"
        self.system = found
        self.action, self.offboard = Action(found), Offboard(found)
        self.telemetry, self.param = Telemetry(found), Param(found)
        self.thrust = 0.0
        self._stop = threading.Event()
        self._stream = threading.Thread(target=self._streaming)

    def stream(self, thrust: float) -> None:
        """Send set_attitude at 50 Hz from now on, level, with this thrust."""
        self.thrust = thrust
        if not self._stream.is_alive():
            self._stream.start()

    def _streaming(self) -> None:
        while not self._stop.wait(0.02):
            self.offboard.set_attitude(Attitude(0.0, 0.0, 0.0, self.thrust))

    def stop_stream(self) -> None:
        self._stop.set()
        if self._stream.is_alive():
            self._stream.join()

    def close(self) -> None:
        self.stop_stream()
        self.mavsdk.destroy()

    def in_mode(self, mode: FlightMode) -> None:
        _wait(lambda: self.telemetry.flight_mode() == mode, f"flight mode {mode.name}")


@pytest.fixture
def pilot() -> Iterator[Pilot]:
    with running() as mock:
        pilot = Pilot(mock)
        yield pilot
        pilot.close()


@pytest.fixture
def indoor_pilot() -> Iterator[Pilot]:
    with running(*NO_GPS) as mock:
        pilot = Pilot(mock)
        yield pilot
        pilot.close()


def test_arming_is_denied_until_the_checks_pass(pilot: Pilot) -> None:
    with pytest.raises(ActionError) as denied:
        pilot.action.arm()
    assert denied.value.result == ActionResult.COMMAND_DENIED
    _wait(pilot.telemetry.health_all_ok, "all healthy")
    _wait(lambda: pilot.telemetry.health().is_armable, "armable")
    pilot.action.arm()
    _wait(pilot.telemetry.armed, "armed")
    pilot.action.disarm()
    _wait(lambda: not pilot.telemetry.armed(), "disarmed")


def test_parameters_have_types_and_unknown_ones_time_out(pilot: Pilot) -> None:
    assert pilot.param.get_param_float("COM_OF_LOSS_T") == pytest.approx(1.0)
    assert pilot.param.get_param_int("COM_RC_IN_MODE") == 1
    pilot.param.set_param_float("MIS_TAKEOFF_ALT", 3.0)
    assert pilot.param.get_param_float("MIS_TAKEOFF_ALT") == pytest.approx(3.0)
    with pytest.raises(ParamError) as wrong:
        pilot.param.get_param_int("COM_OF_LOSS_T")
    assert wrong.value.result == ParamResult.WRONG_TYPE
    with pytest.raises(ParamError) as unknown:
        pilot.param.get_param_float("XXX_UNKNOWN")
    assert unknown.value.result == ParamResult.TIMEOUT


def test_offboard_needs_a_setpoint_first(pilot: Pilot) -> None:
    with pytest.raises(OffboardError) as refused:
        pilot.offboard.start()
    assert refused.value.result == OffboardResult.NO_SETPOINT_SET


def test_without_gps_the_order_is_stream_offboard_arm_and_hold_is_refused(indoor_pilot: Pilot) -> None:
    pilot = indoor_pilot
    with pytest.raises(ActionError):
        pilot.action.arm()
    pilot.stream(0.0)
    time.sleep(0.2)
    pilot.offboard.start()
    pilot.in_mode(FlightMode.OFFBOARD)
    _wait(lambda: pilot.telemetry.health().is_armable, "armable in OFFBOARD")
    pilot.action.arm()
    pilot.stream(0.6)
    _wait(lambda: pilot.telemetry.landed_state() == LandedState.IN_AIR, "in the air")
    pilot.action.hold()  # MAVSDK believes PX4's first ACK; the vehicle stays where it was
    time.sleep(1.2)
    assert pilot.telemetry.flight_mode() == FlightMode.OFFBOARD
    pilot.action.kill()
    _wait(lambda: not pilot.telemetry.armed(), "disarmed by kill")


def test_the_example_flies_and_lands() -> None:
    with running(
        "--param", "MPC_LAND_SPEED=1.2", "--param", "MPC_LAND_CRWL=0.8", "--param", "COM_DISARM_LAND=0.5"
    ) as mock:
        program = [
            sys.executable,
            str(ROOT / "examples" / "offboard_attitude.py"),
            f"udpin://127.0.0.1:{mock.client_port}",
        ]
        flight = subprocess.run(program, capture_output=True, text=True, timeout=90.0, check=False)
    assert flight.returncode == 0, flight.stderr
    assert "landed and disarmed" in flight.stdout


def test_the_global_origin_that_is_set_is_answered_with_the_same_place() -> None:
    with running(*NO_GPS) as mock:
        pilot = Pilot(mock)
        pilot.action.set_gps_global_origin(-33.8567, 151.215, 20.5)  # ActionError after a second without that answer
        origin = pilot.telemetry.get_gps_global_origin()
        pilot.close()
    assert (origin.latitude_deg, origin.longitude_deg) == pytest.approx((-33.8567, 151.215), abs=1e-7)
    assert origin.altitude_m == pytest.approx(20.5, abs=1e-3)


def test_streams_that_a_simulated_px4_grants_may_be_asked_for(pilot: Pilot) -> None:
    pilot.telemetry.set_rate_rc_status(2.0)
    pilot.telemetry.set_rate_ground_truth(10.0)  # TelemetryError when it is refused
    _wait(lambda: pilot.telemetry.ground_truth().latitude_deg > 47.0, "ground truth")
