"""Several vehicles in one room."""
