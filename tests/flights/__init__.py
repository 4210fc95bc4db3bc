"""Whole flights and whole command lines, through the real protocols."""
