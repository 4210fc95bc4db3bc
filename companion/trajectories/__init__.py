"""References over time, and checks that they stay in the room. Pure."""
