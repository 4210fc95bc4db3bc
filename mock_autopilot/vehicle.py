"""What PX4 does with commands, modes and failures."""
