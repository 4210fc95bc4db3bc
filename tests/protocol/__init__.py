"""Tests of the messages between service and clients, companion.protocol."""
