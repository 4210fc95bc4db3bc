"""Terminal functions that several displays share."""

from rich.console import Console


def show_cursor(console: Console) -> None:
    """Show the cursor that a live display hides: a killed process could not restore it."""
    if console.is_terminal:
        console.show_cursor(True)
