"""Fly a PX4 multirotor with attitude setpoints through MAVSDK: up, tilt a little each way, down.

    python -m mock_autopilot --no-qualisys &     # or PX4 SITL, or a real vehicle in a net
    python examples/offboard_attitude.py [udpin://0.0.0.0:14540]

Needs `pip install "mavsdk>=4.1"` and nothing else. Roll and pitch are open loop: the vehicle wanders a few metres.
"""

import contextlib
import sys
import time
from collections.abc import Callable

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.offboard import Attitude, Offboard
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry

RATE_HZ = 50.0
HEIGHT_M = 2.0
HOVER_THRUST = 0.5
TILT_DEG = 4.0
THRUST_PER_M, THRUST_PER_MPS = 0.08, 0.12
THRUST_RANGE = (0.35, 0.65)
EXCURSIONS = ((0.0, 0.0, 4.0), (TILT_DEG, 0.0, 1.0), (-TILT_DEG, 0.0, 1.0), (0.0, TILT_DEG, 1.0), (0.0, -TILT_DEG, 1.0))
"""Roll (deg), pitch (deg), for how long (s); the first is the climb."""


def main(url: str) -> int:
    """One flight; 0 when the vehicle is back on the ground and disarmed."""
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        mavsdk.add_any_connection(url)
        system = mavsdk.first_autopilot(timeout_s=15.0)
        if system is None:
            print(f"no autopilot heard on {url}", file=sys.stderr)
            return 1
        action, offboard, telemetry = Action(system), Offboard(system), Telemetry(system)
        arm(action)
        try:
            fly(offboard, telemetry)
        finally:
            action.land()
        wait_until(lambda: not telemetry.armed(), 40.0, "disarmed")
        print("landed and disarmed")
    return 0


def arm(action: Action) -> None:
    """PX4 refuses until its checks have passed, some seconds after boot: ask again."""
    for _ in range(20):
        with contextlib.suppress(ActionError):
            action.arm()
            return
        time.sleep(1.0)
    action.arm()


def fly(offboard: Offboard, telemetry: Telemetry) -> None:
    """Stream first, then OFFBOARD, then the excursions at constant height."""
    telemetry.set_rate_position_velocity_ned(RATE_HZ)
    start_m = height_m(telemetry)
    yaw_deg = telemetry.attitude_euler().yaw_deg
    offboard.set_attitude(Attitude(0.0, 0.0, yaw_deg, 0.0))
    offboard.start()
    # PX4 acknowledges a mode before it has decided on it; only its heartbeat tells the truth.
    wait_until(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD, 3.0, "in OFFBOARD")
    for roll_deg, pitch_deg, for_s in EXCURSIONS:
        print(f"roll {roll_deg:+.0f}, pitch {pitch_deg:+.0f} deg at {height_m(telemetry) - start_m:.1f} m")
        until = time.monotonic() + for_s
        while time.monotonic() < until:
            thrust = thrust_for(telemetry, start_m + HEIGHT_M)
            offboard.set_attitude(Attitude(roll_deg, pitch_deg, yaw_deg, thrust))
            time.sleep(1.0 / RATE_HZ)
    if telemetry.landed_state() == LandedState.ON_GROUND:
        raise RuntimeError("the vehicle did not leave the ground")


def height_m(telemetry: Telemetry) -> float:
    """Height above the local origin."""
    return -float(telemetry.position_velocity_ned().position.down_m)


def thrust_for(telemetry: Telemetry, wanted_m: float) -> float:
    """A plain PD loop around the hover thrust."""
    climb_mps = -float(telemetry.position_velocity_ned().velocity.down_m_s)
    thrust = HOVER_THRUST + THRUST_PER_M * (wanted_m - height_m(telemetry)) - THRUST_PER_MPS * climb_mps
    return min(max(thrust, THRUST_RANGE[0]), THRUST_RANGE[1])


def wait_until(reached: Callable[[], bool], timeout_s: float, what: str) -> None:
    """Poll; TimeoutError in plain words when it does not come true."""
    until = time.monotonic() + timeout_s
    while not reached():
        if time.monotonic() > until:
            raise TimeoutError(f"not {what} within {timeout_s:.0f} s")
        time.sleep(0.05)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else "udpin://0.0.0.0:14540"))
