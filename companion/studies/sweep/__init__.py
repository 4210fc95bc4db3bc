"""Robustness: many vehicles drawn at random, flown side by side."""
