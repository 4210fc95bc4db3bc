"""The simulated vehicle: rigid-body plant, disturbances, arms. Pure."""
