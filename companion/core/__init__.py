"""Values, interfaces and errors that every package shares; imports nothing else of the project."""
