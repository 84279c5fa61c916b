"""Flaws of frames in which an object is seen, but gives no angle."""

from enum import StrEnum


class Flaw(StrEnum):
    """Flaws of frames in which something touches, but gives no angle.

    Attributes:
        NOT_SETTLED: a contact at the picture's edge keeps coming into view.
        TOO_LIGHT: only the light shows a contact.
        DEPARTED: the object's print has faded, and the gel has not yet come to rest.
    """

    NOT_SETTLED = "a contact at the edge of the view has not settled"
    TOO_LIGHT = "the object touches too lightly to move the markers"
    DEPARTED = "the object's print has faded: it has left the view"


UNHELD_FLAWS = frozenset({Flaw.TOO_LIGHT, Flaw.DEPARTED})
"""Flaws of frames that hold nothing: the next angle counts from the next contact."""
