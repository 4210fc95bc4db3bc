"""Random flights of several vehicles in one simulated room, over many seeds, and what they are judged by."""
