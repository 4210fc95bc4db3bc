"""Parameters of vehicle and room, identified from a recorded hover flight. Pure."""
