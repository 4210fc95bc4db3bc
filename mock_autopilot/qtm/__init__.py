"""The mock Qualisys server."""
