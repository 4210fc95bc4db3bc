"""Tests of companion.client."""
