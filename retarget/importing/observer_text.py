"""The proposal of `fit-observers` as the sections of a drafted profile."""

import json

__all__ = ["observer_text"]

HEAD = "# Proposed as retarget fit-observers does; what the comments mean is in docs/fitting.md.\n"
EMPTY = "ignore_pairs: []"


def observer_text(fitted: str, touching: tuple[tuple[str, str], ...]) -> str:
    """Without what is said to somebody who copies it; with pairs that touch in the drafted postures ignored too."""
    text = HEAD + fitted[fitted.index("observers:\n") :]
    if not touching:
        return text
    reason = "touch in the drafted postures: draw their shapes tighter, or move the postures, then remove this"
    lines = "\n".join(
        f"  - pair: [{json.dumps(first)}, {json.dumps(second)}]  # DRAFT\n    reason: {json.dumps(reason)}"
        for first, second in touching
    )
    place = "ignore_pairs:\n"
    if EMPTY in text:
        return text.replace(EMPTY, place + lines)
    return text.replace(place, place + lines + "\n")
