"""Link between a control law on the ground and the vehicle: messages, sessions, clocks, plans. Pure."""
