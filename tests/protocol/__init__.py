"""Tests of companion.protocol."""
