"""Tests of companion.geometry."""
