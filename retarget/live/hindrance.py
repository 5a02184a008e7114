"""Why a performer is not followed, in a few words: the reason of a stop where that lasts too long."""

from dataclasses import dataclass

from retarget.frames import BoolArray
from retarget.live.trust_state import StateArray, TrustState

__all__ = ["Hindered", "hindrance_of"]

WORDS = {
    TrustState.STALE: "lost",
    TrustState.FROZEN: "frozen",
    TrustState.JUMPED: "jumped",
    TrustState.SWAPPED: "changed places",
    TrustState.NOT_WORN: "not heard",
    TrustState.OUT_OF_RANGE: "outside the room",
}
TOO_SHORT = "not for long enough at a time"


@dataclass(frozen=True, slots=True, eq=False)
class Hindered:
    """What the last tick knew of k sensors. states (k,): a `TrustState` each; leapt (k,): who may not be followed to
    where they are; carrying: rows of those that are needed; late: whether ticks come late; trouble: of the stream, ""
    for none; came_back: whether data were good in the meantime, and not for long enough."""

    states: StateArray
    leapt: BoolArray
    carrying: tuple[int, ...]
    late: bool
    trouble: str
    came_back: bool = False


def hindrance_of(names: tuple[str, ...], hindered: Hindered) -> str:
    """What is in the way now; where it has not been all the time, that comes first."""
    now = _now(names, hindered)
    if not now:
        return TOO_SHORT
    return f"{TOO_SHORT}, at last: {now}" if hindered.came_back else now


def _now(names: tuple[str, ...], hindered: Hindered) -> str:
    """The first that applies: the stream, the sensors of `names` (k,), the ticks; "" for none."""
    if hindered.trouble:
        return hindered.trouble
    told = [
        f"{name}: {WORDS[state]}"
        for row, (name, state) in enumerate(zip(names, map(TrustState, hindered.states.tolist()), strict=True))
        if state in WORDS and (row in hindered.carrying or hindered.leapt[row])
    ]
    if told:
        return ", ".join(told)
    return "ticks came late" if hindered.late else ""
