"""The arms' servos (Dynamixel AX and XM on one half-duplex bus) as an ArmBus, over dynamixel-sdk."""

from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel

__all__ = ["DynamixelBus", "open_dynamixel"]
