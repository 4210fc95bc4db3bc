"""Pure: flight phases and what follows from what is known."""
