"""Flights in virtual time and their pictures."""
