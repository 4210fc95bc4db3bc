"""Tests of companion.supervisor.health."""
