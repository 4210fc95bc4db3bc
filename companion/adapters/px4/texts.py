"""STATUSTEXT: short texts of PX4, long ones in pieces, with any bytes."""

from dataclasses import dataclass

_PIECE = 50
"""Characters of one STATUSTEXT; a shorter piece is the last one."""


@dataclass(frozen=True)
class TextPieces:
    """A text whose last piece has not come yet; MAVLink's `id` says which pieces belong together, 0: a whole text."""

    id: int = 0
    text: str = ""

    def add(self, id_: int, piece: str) -> tuple["TextPieces", tuple[str, ...]]:
        """Return what is still incomplete and the texts that are whole now; one whose end was lost ends here."""
        lost_end = (self.text,) if self.text and id_ != self.id else ()
        text = self.text + piece if id_ and id_ == self.id else piece
        if id_ and len(piece) >= _PIECE:
            return TextPieces(id_, text), lost_end
        return TextPieces(), (*lost_end, text)
