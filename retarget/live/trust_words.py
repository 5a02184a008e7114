"""What a person is told when trust in a sensor changes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from retarget.frames import mirrored_name
from retarget.live.trust_state import TrustState

__all__ = ["TrustChange", "lasting", "sentences"]


@dataclass(frozen=True, slots=True)
class TrustChange:
    """Of one sensor by its name, judged at `now`, s. seconds: since when it is as it is now, where that is known.
    resettled: it is believed at another place than where it was doubted."""

    now: float
    name: str
    before: TrustState
    after: TrustState
    seconds: float = 0.0
    resettled: bool = False


def lasting(changes: Sequence[TrustChange]) -> list[TrustChange]:
    """Those of sensors that are not what they were before: nobody needs to hear what came and went unheard."""
    first: dict[str, TrustChange] = {}
    last: dict[str, TrustChange] = {}
    for change in changes:
        first.setdefault(change.name, change)
        last[change.name] = change
    same = {name for name in first if first[name].before is last[name].after and not last[name].resettled}
    return [change for change in changes if change.name not in same]


def sentences(changes: Iterable[TrustChange]) -> list[str]:
    """One for all sensors that changed alike at one time, in order."""
    told = []
    for _, alike in groupby(changes, key=lambda change: (change.now, change.before, change.after, change.resettled)):
        group = list(alike)
        names = [change.name for change in group]
        if group[0].after is TrustState.SWAPPED:
            told += _exchanges(names)
        else:
            told.append(f"{', '.join(names)}: {_text(group[0], max(change.seconds for change in group))}")
    return told


def _exchanges(names: Sequence[str]) -> list[str]:
    pairs = [f"{name} and {mirrored_name(name)}" for name in names if name.startswith("l_")]
    return [f"{pair} have changed places: the robot holds until they change back" for pair in pairs]


def _text(change: TrustChange, seconds: float) -> str:
    if change.after is TrustState.FRESH:
        if change.resettled:
            return "believed again where it is now"
        return "heard now" if change.before is TrustState.NOT_WORN else "back"
    return {
        TrustState.STALE: f"nothing that can be used for {seconds:.1f} s" if seconds else "not heard yet",
        TrustState.FROZEN: f"frozen since {seconds:.1f} s (tracker lost?)",
        TrustState.JUMPED: "jumped farther than a human can",
        TrustState.NOT_WORN: "not heard since the start (not worn?)",
        TrustState.OUT_OF_RANGE: "told to be outside the room",
    }[change.after]
