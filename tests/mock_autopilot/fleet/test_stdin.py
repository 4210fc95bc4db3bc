"""Commands on the mock's standard input for one vehicle of several, and what it reports of two that meet."""

import asyncio

import pytest

from mock_autopilot.__main__ import _ready_line, _report_collision, _StdinCommands
from mock_autopilot.config import MockConfig
from mock_autopilot.faults.catalogue import Part
from mock_autopilot.servos.config import FaultKind
from mock_autopilot.simulator import Simulator


@pytest.fixture
def simulator() -> Simulator:
    config = {"fleet": {"vehicles": 2}, "arms": {"enabled": True}}
    simulator = Simulator(MockConfig.from_dict(config), 1)
    assert simulator.fleet is not None
    simulator.fleet.collision_observers.append(lambda met: _report_collision(simulator, met))
    return simulator


def _execute(simulator: Simulator, *lines: str) -> None:
    commands = _StdinCommands(simulator, asyncio.Event())
    for line in lines:
        commands._execute(line)


def test_a_command_reaches_the_vehicle_that_it_names(simulator: Simulator) -> None:
    _execute(simulator, "fault link off", "fault vehicle 2: mocap stuck")
    first, second = simulator.worlds
    assert [len(world.faults.active(Part.LINK)) for world in (first, second)] == [1, 0]
    assert [len(world.faults.active(Part.MOCAP)) for world in (first, second)] == [0, 1]
    _execute(simulator, f'servo-fault vehicle 2: {{"kind": "{FaultKind.SILENT_BUS}"}}')
    assert [bus.servos.active(FaultKind.SILENT_BUS) for bus in simulator.servo_buses] == [False, True]


@pytest.mark.parametrize("line", ["carry vehicle 3: 0 0 0", "fault vehicle 3: mocap off", "servo-fault vehicle 3: {}"])
def test_a_vehicle_that_is_not_there_is_refused(simulator: Simulator, line: str) -> None:
    with pytest.raises(ValueError, match="there is no vehicle 3 here; 2 in all"):
        _execute(simulator, line)


def test_two_that_meet_are_reported_and_can_be_asked_for(
    simulator: Simulator, capsys: pytest.CaptureFixture[str]
) -> None:
    assert simulator.fleet is not None
    _execute(simulator, "collisions", "carry vehicle 2: 0 0.8 0")
    simulator.fleet.advance(1.5)
    _execute(simulator, "collisions")
    out, err = capsys.readouterr()
    before, met, after = out.splitlines()
    assert (before, after) == ("collisions: none", "collisions: dauam-1 and dauam-2")
    assert met.startswith("collision at ")
    assert met.endswith(" s (monotonic): dauam-1 and dauam-2")
    assert err == "mock autopilot: dauam-1 and dauam-2 have collided, their motors have stopped\n"


def test_the_ready_line_names_every_port(simulator: Simulator) -> None:
    line = _ready_line(simulator, 1)
    assert "MAVLink udp 14580 -> 127.0.0.1:14540, MAVLink udp 14581 -> 127.0.0.1:14541, Qualisys tcp 22223" in line
