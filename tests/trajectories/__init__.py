"""Tests of references and the room check, companion.trajectories."""
