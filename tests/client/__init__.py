"""Tests of the operator's side of the protocol, package companion.client."""
