"""Recorded inputs through estimator and control law again, compared to the last bit. Pure."""
