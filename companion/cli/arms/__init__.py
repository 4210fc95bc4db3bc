"""Commands for the arms, on the bench and in the running service."""
