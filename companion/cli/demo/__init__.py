"""`companion demo`: a whole flight against the mocks."""
