"""The mock Dynamixel bus: servos, protocols and the pseudo-terminal."""
