"""Faults that can be injected into the mocks, and when."""
