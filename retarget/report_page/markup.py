"""HTML from text that nobody vouches for: whatever is not `Markup` already is escaped."""

from collections.abc import Iterable
from html import escape
from typing import NewType

__all__ = ["Markup", "element", "joined", "safe"]

Markup = NewType("Markup", str)
"""HTML that is as it should be: made here, or from our own files."""

VOID = frozenset({"meta", "input", "br"})


def safe(content: object) -> Markup:
    """Text, escaped; nothing for None."""
    return Markup("" if content is None else escape(str(content), quote=True))


def element(tag: str, *children: Markup, **attributes: str | None) -> Markup:
    """An element. A child that is a plain str does not pass the type check: it goes through `safe` first.

    attributes: `class_` for class, _ for -; None is left out; values are escaped.
    """
    said = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(value, quote=True)}"'
        for name, value in attributes.items()
        if value is not None
    )
    if tag in VOID:
        return Markup(f"<{tag}{said}>")
    return Markup(f"<{tag}{said}>{''.join(children)}</{tag}>")


def joined(parts: Iterable[Markup]) -> Markup:
    """Several in a row."""
    return Markup("".join(parts))
