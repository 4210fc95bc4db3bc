"""Reports of flights: numbers, figures, HTML pages."""
