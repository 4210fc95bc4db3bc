"""From records to numbers, figures and pages."""
