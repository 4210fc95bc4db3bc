"""Tests of flights in virtual time, companion.simulation."""
