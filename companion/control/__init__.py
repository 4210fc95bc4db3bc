"""Pure: the control law of the paper, from reference to attitude and thrust. Nothing here does I/O."""
