"""Tests of companion.simulation."""
