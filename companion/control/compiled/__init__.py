"""Compiled twins of what decides a setpoint: their numbers, what is traced, and the classes that a flight calls."""
