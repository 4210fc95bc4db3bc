"""Checks before a vehicle may arm: pure functions from plain facts to `Check`s."""
