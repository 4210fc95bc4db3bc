"""Tests of reports, calibration and replay, package companion.analysis."""
