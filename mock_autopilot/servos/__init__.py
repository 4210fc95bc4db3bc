"""The mock Dynamixel bus."""
