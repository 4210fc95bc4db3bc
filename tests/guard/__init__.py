"""Tests of companion.guard."""
