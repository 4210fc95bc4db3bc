"""Checks of a standing vehicle: facts in, verdicts out. Pure."""
