"""Tests of the link between a law on the ground and the vehicle."""
