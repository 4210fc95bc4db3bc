"""Tests of companion.trajectories."""
