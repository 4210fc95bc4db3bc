"""Tests of companion.studies."""
