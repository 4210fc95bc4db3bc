"""Tests of companion.analysis."""
