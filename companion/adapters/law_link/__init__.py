"""UDP sockets of the link between a control law on the ground and the vehicle."""
