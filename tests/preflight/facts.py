"""A vehicle that is ready in every respect, to spoil one thing at a time."""

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from companion.config.preflight_config import load_recommended
from companion.core.types import AutopilotStatus, FlightMode
from companion.preflight.checks.agreement import Difference, VisionFacts
from companion.preflight.checks.all_checks import CURVE, DELAY, HOVER, Facts
from companion.preflight.checks.computer import ComputerFacts
from companion.preflight.checks.hand_test import HandTest
from companion.preflight.checks.mocap import MocapFacts
from companion.preflight.checks.vehicle import ServoFacts
from mock_autopilot.config import MockConfig
from mock_autopilot.px4.params import ParamTable

ROOT = Path(__file__).resolve().parents[2]
NOW_S = 100.0
RECOMMENDED = load_recommended("recommended")
MOCAP = MocapFacts(body="dauam", frames=150, seconds_s=1.5, tracked=150, age_s=0.02, delay_s=0.011, residual_m=0.0005)
MACHINE = ComputerFacts(5000.0, 1e-9, True, True, 50, 0)
ARMS = ServoFacts(0.01, "", "")
STATUS = AutopilotStatus(
    connected=True,
    heartbeat_s=NOW_S - 0.5,
    armed=False,
    mode=FlightMode.HOLD,
    in_air=False,
    battery_fraction=0.95,
    battery_v=16.4,
    q_w_flu_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
    last_text="",
    heard_s=NOW_S - 0.01,
    boot_s=60.0,
)


def mock_parameters() -> dict[str, float]:
    """Return the parameters of the demo's vehicle."""
    table = ParamTable(MockConfig.load(ROOT / "config" / "mock.toml").px4.params)
    return {name: table[name] for name in (*RECOMMENDED, DELAY, HOVER, CURVE)}


def ready() -> Facts:
    """Return facts with which every check passes."""
    now = datetime(2026, 5, 1, 12, 0, tzinfo=UTC)
    return Facts(
        time_s=NOW_S,
        when=now,
        mocap=MOCAP,
        position_w_m=np.array([0.3, -0.2, 0.1]),
        status=STATUS,
        apart=Difference(0.01, -0.01, math.radians(2.0)),
        vision=VisionFacts(True, 0.02),
        parameters=mock_parameters(),
        arms=ARMS,
        machine=MACHINE,
        kept=HandTest("dauam", now),
        operator_age_s=0.0,
    )
