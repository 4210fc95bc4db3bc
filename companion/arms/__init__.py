"""Pure: kinematics and trajectories of the two arms."""
