"""Search for controller gains."""
