"""A recorded flight fed through estimator and control law again: the same to the last bit, or how it differs; pure."""
