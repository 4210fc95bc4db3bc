"""The demo of several vehicles: one service process for each, one room, one broker."""
