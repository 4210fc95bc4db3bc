"""Recorded PX4 sessions, re-enacted on the mock: what PX4 heard goes in, what it said is compared event by event."""
