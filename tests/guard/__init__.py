"""Tests of limits, geofence and guard, companion.guard."""
