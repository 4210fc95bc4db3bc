"""Rotations, and conversion between acceleration and attitude with thrust. Pure; one vehicle or a batch."""
