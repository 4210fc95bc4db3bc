"""The arms' servos (Dynamixel AX and XM on one half-duplex bus) as an ArmBus, over dynamixel-sdk."""

from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel
from companion.adapters.dynamixel.checks import model_name
from companion.adapters.dynamixel.found import Found
from companion.adapters.dynamixel.inspection import Inspected

__all__ = ["DynamixelBus", "Found", "Inspected", "model_name", "open_dynamixel"]
