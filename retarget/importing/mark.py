"""The mark on lines of a drafted profile that somebody who knows the robot must look at."""

__all__ = ["DRAFT", "marked_lines"]

DRAFT = "# DRAFT"


def marked_lines(text: str) -> tuple[int, ...]:
    """Numbers, from 1, of the lines of a profile that still bear the mark after what they say."""
    lines = enumerate(text.splitlines(), 1)
    return tuple(number for number, line in lines if DRAFT in line and not line.lstrip().startswith("#"))
