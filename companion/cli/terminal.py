"""Small things about the terminal that several displays need."""

from rich.console import Console


def show_cursor(console: Console) -> None:
    """Bring back the cursor that a live display hides: who is killed meanwhile cannot."""
    if console.is_terminal:
        console.show_cursor(True)
