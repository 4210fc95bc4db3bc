"""Supervisor: faults, failsafe actions and the flight's state machine. Pure."""
