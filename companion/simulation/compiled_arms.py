"""The arms' servos driven by compiled code: the same angles as in Python, to the last bit."""

import ctypes
import math

import numpy as np

from companion.compiled.leaves import leaves
from companion.compiled.library import library
from companion.core.types import Array
from companion.simulation.traces import assembly_numbers, servo_of
from mock_autopilot.physics.arm_table import SETTLE_STEPS, Drive, angles_of
from mock_autopilot.world import STEP_S


def driven(drive: Drive) -> Array:
    """Do what `angles_of` does, in less time where it can be; profiles that limit a speed are left to Python."""
    code = library()
    if code is None or any(motor.profile_limit_radps < math.inf for motor in drive.motors):
        return angles_of(drive)
    angles = np.empty((drive.count + 1, len(drive.motors)))
    tables = (
        np.array([[number for _, number in leaves(servo_of(motor))] for motor in drive.motors]),
        np.array([number for _, number in leaves(assembly_numbers(drive.assembly))]),
        np.ascontiguousarray(drive.goals_rad),
        np.array(drive.due, dtype=np.int64),
    )
    code.drive_servos(
        *(ctypes.c_void_p(table.ctypes.data) for table in tables),
        *(ctypes.c_int64(number) for number in (len(drive.due), SETTLE_STEPS, drive.count)),
        ctypes.c_double(STEP_S),
        ctypes.c_void_p(angles.ctypes.data),
    )
    return angles
