"""A simulated vehicle behind real protocols: PX4 over MAVLink and a Qualisys server, fed by one truth."""
