"""Qualisys Track Manager as a MocapSource, over its real-time protocol (qtm-rt)."""
