"""`companion mocap`, and what preflight and dry-run say of motion capture when nothing else is there."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.cli.demo.mock_process import free_ports
from companion.core.types import MocapFrame, VehicleState
from companion.estimation.estimator import EstimatorState
from companion.preflight.checks.check import Check
from companion.preflight.checks.mocap import MocapWatch
from companion.preflight.live_observer import DevicesMissingError
from mock_autopilot.qtm.server import QualisysServer
from tests.adapters.qualisys.rig import capturing, serving
from tests.flights.command import run, start

pytestmark = pytest.mark.slow


def configured(folder: Path, server: QualisysServer) -> Path:
    """A configuration whose autopilot is not there."""
    path = folder / "companion.toml"
    url = f"udpin://127.0.0.1:{free_ports().client}"
    path.write_text(
        f'[mocap]\nport = {server.port}\n[px4]\nurl = "{url}"\nconnect_timeout_s = 0.2\n[preflight]\nrealtime = false\n'
    )
    return path


async def test_place_and_checks_are_shown_without_an_autopilot(tmp_path: Path) -> None:
    async with serving() as server, capturing(server):
        ran = await run("mocap", "--config", configured(tmp_path, server), "--seconds", "1")
    assert ran.err == ""
    lines = {line.split("  ")[0]: line for line in ran.out.splitlines()}
    assert "z +1.000 m" in lines["place"]
    assert "is seen; missed in 0 of " in lines["body"]
    assert any(line.startswith("pass  body seen") for line in ran.out.splitlines())


async def test_ctrl_c_ends_the_look_with_its_checks(tmp_path: Path) -> None:
    async with serving() as server, capturing(server):
        looking = await start("mocap", "--config", configured(tmp_path, server), "--seconds", "3000", "--json")
        await looking.until_error("looking at motion capture at 127.0.0.1")
        looking.interrupt()
        ran = await looking.ended()
    assert ran.code in {0, 1}, ran.said
    assert [check["name"] for check in json.loads(ran.out)] == [
        "body seen",
        "mocap rate",
        "mocap age",
        "mocap residual",
    ]


async def test_a_body_that_is_not_tracked_is_said_so(tmp_path: Path) -> None:
    async with serving(outages=[{"start_s": 0.0, "for_s": 1e9}]) as server, capturing(server):
        ran = await run("mocap", "--config", configured(tmp_path, server), "--seconds", "1")
    assert ran.code == 1, ran.said
    assert "'dauam' is NOT SEEN now" in ran.out
    assert "no pose yet" in ran.out
    assert "not good enough for a flight" in ran.out


async def test_preflight_tells_of_motion_capture_when_the_autopilot_is_missing(tmp_path: Path) -> None:
    async with serving() as server, capturing(server):
        config = configured(tmp_path, server)
        ran = await run("preflight", "--config", config, "--out", tmp_path, "--json")
    assert ran.code == 1, ran.said
    checks = {check["name"]: check for check in json.loads(ran.out)}
    assert {"body seen", "mocap rate", "mocap age", "mocap residual"} < set(checks)
    assert checks["body seen"]["passed"]
    assert not checks["autopilot"]["passed"]


def test_what_is_missing_leads_to_a_look_at_what_is_there() -> None:
    autopilot, seen = Check("autopilot", False, "no autopilot heard"), Check("body seen", False, "in 3 % of 100 frames")
    missing = DevicesMissingError((Check("motion capture", True, "reached"), autopilot), (seen,))
    assert str(missing).splitlines()[0] == "no autopilot heard"
    assert "`companion mocap` shows it without the rest" in str(missing)
    assert str(DevicesMissingError((autopilot,), ())) == "no autopilot heard"


class Scripted:
    """A motion capture that holds one frame."""

    def __init__(self) -> None:
        self.frame: MocapFrame | None = None

    def latest(self) -> MocapFrame | None:
        return self.frame

    def why_silent(self) -> str:
        return ""

    async def wait_frame(self, timeout_s: float) -> bool:
        raise NotImplementedError


FRAME = MocapFrame(
    frame=1, stamp_s=0.0, received_s=0.01, position_w_m=np.zeros(3), rotation_w_b=np.eye(3), residual_m=0.001
)


@pytest.mark.parametrize(("untracked", "residual_m"), [(0, 0.001), (5, 0.001), (10, math.nan)])
def test_a_watch_counts_frames_once_and_knows_which_had_the_body(untracked: int, residual_m: float) -> None:
    source, state = Scripted(), EstimatorState()
    watch = MocapWatch(source, lambda: state, 0.01)
    for number in range(10):
        lost = number < untracked
        where = np.full(3, np.nan) if lost else np.zeros(3)
        source.frame = replace(FRAME, frame=number, position_w_m=where)
        for _ in range(3):
            watch.look(0.01 * number)
    seen = watch.seen("dauam", 0.1)
    assert (seen.frames, seen.tracked) == (10, 10 - untracked)
    assert seen.rate_hz == pytest.approx(100.0)
    assert seen.age_s == math.inf, "the estimator has no pose"
    assert seen.residual_m == pytest.approx(residual_m, nan_ok=True)


def test_the_age_is_that_of_the_slowest_twentieth() -> None:
    source = Scripted()
    vehicle = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    state = replace(EstimatorState(), vehicle=vehicle)
    watch = MocapWatch(source, lambda: state, 0.01)
    for number in range(100):
        watch.look(0.001 * number)
    assert watch.seen("dauam", 0.1).age_s == pytest.approx(0.095)
