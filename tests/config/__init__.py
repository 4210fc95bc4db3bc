"""Tests of companion.config."""
