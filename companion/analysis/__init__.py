"""Numbers, figures and pages computed from records."""
