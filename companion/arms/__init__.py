"""The two arms, pure: geometry, what their motion does to the vehicle, joint trajectories, and their state machine."""
