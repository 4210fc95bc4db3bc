"""Configuration of the servo bus, and the messages for mistakes."""

import math
from typing import Any

import pytest
from pydantic import ValidationError

from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind
from mock_autopilot.servos.control_tables import MODELS, Model


def test_by_default_there_are_two_arms_of_three_xm_and_an_ax() -> None:
    servos = DynamixelConfig().servos
    assert [servo.id for servo in servos] == list(range(1, 9))
    assert [servo.model for servo in servos] == 2 * ([*3 * ["XM430-W350"], "AX-12A"])
    assert {servo.baud for servo in servos} == {1_000_000}


def test_faults_are_read_with_their_times() -> None:
    config = DynamixelConfig.model_validate({"faults": [{"kind": "missing", "id": 3, "at_s": 5.0}]})
    assert config.faults == (Fault(kind=FaultKind.MISSING, id=3, at_s=5.0, for_s=math.inf),)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"servos": [{"id": 1}, {"id": 1}]}, "two servos have ID 1"),
        ({"servos": [{"id": 1, "model": "MX-28"}]}, "must be one of XM430-W350, XM430-W210, AX-12A"),
        ({"servos": [{"id": 1, "baud": 12345}]}, "XM430-W350 cannot talk at 12345 baud; it knows 9600, 57600"),
        ({"servos": [{"id": 1, "registers": {"homing": 1}}]}, "XM430-W350 has no register homing; it has model_number"),
        ({"servos": [{"id": 7, "start_position_rad": 7.0}]}, "start_position_rad of servo 7 is 7.0; XM430-W350 has 0"),
        ({"faults": [{"kind": "hot", "id": 9}]}, r"fault hot cannot have id 9: there are \[1, 2"),
        ({"faults": [{"kind": "port_gone", "id": 1}]}, "fault port_gone cannot have id 1: concerns the whole bus"),
        ({"faults": [{"kind": "tired"}]}, "Input should be 'missing', 'late'"),
        ({"linc": "/tmp/x"}, "Extra inputs are not permitted"),
    ],
)
def test_a_mistake_is_named(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        DynamixelConfig.model_validate(values)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_no_two_registers_overlap_and_every_default_is_in_range(model: Model) -> None:
    taken: set[int] = set()
    for register in model.registers:
        places = set(range(register.address, register.end))
        assert not places & taken, register.name
        taken |= places
        if register.writable and register.name != "secondary_id":
            assert register.minimum <= register.default <= register.maximum, register.name


@pytest.mark.parametrize(
    ("model", "name", "address", "size", "default"),
    [
        # e-manual, "Control Table of EEPROM Area" and "of RAM Area"
        ("XM430-W350", "model_number", 0, 2, 1020),
        ("XM430-W210", "model_number", 0, 2, 1030),
        ("XM430-W350", "operating_mode", 11, 1, 3),
        ("XM430-W350", "current_limit", 38, 2, 1193),
        ("XM430-W350", "shutdown", 63, 1, 52),
        ("XM430-W350", "torque_enable", 64, 1, 0),
        ("XM430-W350", "hardware_error_status", 70, 1, 0),
        ("XM430-W350", "position_p_gain", 84, 2, 800),
        ("XM430-W350", "profile_velocity", 112, 4, 0),
        ("XM430-W350", "goal_position", 116, 4, 0),
        ("XM430-W350", "present_current", 126, 2, 0),
        ("XM430-W350", "present_position", 132, 4, 0),
        ("XM430-W350", "present_temperature", 146, 1, 0),
        ("XM430-W350", "indirect_address_28", 222, 2, 251),
        ("XM430-W350", "indirect_data_28", 251, 1, 0),
        ("AX-12A", "model_number", 0, 2, 12),
        ("AX-12A", "ccw_angle_limit", 8, 2, 1023),
        ("AX-12A", "shutdown", 18, 1, 36),
        ("AX-12A", "goal_position", 30, 2, 0),
        ("AX-12A", "torque_limit", 34, 2, 1023),
        ("AX-12A", "present_position", 36, 2, 0),
        ("AX-12A", "present_load", 40, 2, 0),
        ("AX-12A", "present_temperature", 43, 1, 0),
    ],
)
def test_registers_are_where_the_manual_has_them(model: str, name: str, address: int, size: int, default: int) -> None:
    register = next(one for one in MODELS if one.name == model).by_name[name]
    assert (register.address, register.size, register.default) == (address, size, default)
