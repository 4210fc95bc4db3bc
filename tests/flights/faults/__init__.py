"""Whole flights in which something goes wrong: the table, who flies it, and the report (docs/safety.md)."""
