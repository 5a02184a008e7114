"""The conventions of what is exported, in words that travel with the data."""

from typing import Final

__all__ = ["CONVENTIONS"]

CONVENTIONS: Final = {
    "world": "right-handed, x forward, y left, z up (REP-103), metres; the ground is z = 0",
    "root": "origin and orientation of the body's first link, in the world",
    "joints": "what was sent to the servos: rad of a hinge, m of a slide, zero as in the body file",
    "time": "seconds, 0 at the first tick of following",
}
"""What: how. Each format states the order of its quaternions itself."""
