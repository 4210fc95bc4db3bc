"""Out of records: numbers, figures and pages of flights, and what a hover flight says about the vehicle."""
