"""Tests of companion.service."""
