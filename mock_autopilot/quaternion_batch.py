"""Moved into quaternion.py."""
