"""The arms' servos (Dynamixel AX and XM on one half-duplex bus) as an ArmBus, over dynamixel-sdk."""
