"""The daemon: devices, flight loop, and commands accepted and completed."""
