"""Flights in virtual time against the mock's plant."""
