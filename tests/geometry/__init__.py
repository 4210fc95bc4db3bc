"""Tests of rotations and thrust conversion, companion.geometry."""
