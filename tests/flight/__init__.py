"""Tests of companion.flight."""
