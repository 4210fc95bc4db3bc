"""Tests of the daemon and its commands, package companion.service."""
