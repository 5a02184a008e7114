"""Which pairs of links need no check, each with the numbers that say so."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from retarget.body import BodyModel
from retarget.fitting.own_geoms import OwnDistances
from retarget.fitting.proposals import Proposal
from retarget.fitting.shape_model import Pair
from retarget.fitting.survey import PairRecord
from retarget.observer_pairs import NEVER_NEAR

__all__ = ["Verdict", "always_overlapping", "verdicts"]

Kind = Literal["always", "excluded", "neighbours", "never"]


@dataclass(frozen=True)
class Verdict:
    """A pair of links that is proposed to be ignored. warning: what is lost by that, else empty."""

    kind: Kind
    links: tuple[str, str]
    reason: str
    warning: str = ""


def always_overlapping(records: Sequence[PairRecord]) -> list[PairRecord]:
    """The pairs whose shapes were never apart."""
    return [record for record in records if record.largest is not None]


def verdicts(
    records: Sequence[PairRecord],
    proposals: tuple[Proposal, ...],
    body: BodyModel,
    *,
    near: float,
    own: Sequence[OwnDistances],
    excluded: set[tuple[int, int]],
) -> tuple[Verdict, ...]:
    """The pairs to ignore: first those that always overlap, last those that never come as near as `near`, m.

    own: of the pairs that always overlap, in their order. excluded: sorted link numbers of the body file's own pairs.
    """
    by_pair = {record.pair: distances for record, distances in zip(always_overlapping(records), own, strict=True)}
    found = []
    for record in records:
        first, second = (proposals[place] for place in record.pair)
        names = (first.link_name, second.link_name)
        if record.largest is not None:
            found.append(_always(record, record.largest, names, by_pair[record.pair]))
        elif (min(first.link, second.link), max(first.link, second.link)) in excluded:
            found.append(Verdict("excluded", names, f"the body file excludes their contact, {_closest(record)}"))
        elif record.at_neutral <= 0.0 and _neighbours(record.pair, proposals, body):
            reason = f"neighbours along the tree with no volume between them, {_closest(record)}"
            found.append(Verdict("neighbours", names, reason))
        elif record.smallest > near:
            reason = f"{NEVER_NEAR}, {_closest(record)}"
            found.append(Verdict("never", names, reason))
    order: tuple[Kind, ...] = ("always", "excluded", "neighbours", "never")
    return tuple(sorted(found, key=lambda verdict: order.index(verdict.kind)))


def _always(record: PairRecord, largest: float, names: tuple[str, str], own: OwnDistances) -> Verdict:
    deep = f"{_mm(-largest)} to {_mm(-record.smallest)} mm deep"
    reason = f"overlap at every posture, {deep} ({_looks(record)})"
    if own.largest <= 0.0:
        return Verdict("always", names, f"{reason}, and so do the links' own geoms")
    if not own.may_collide:
        return Verdict("always", names, f"{reason}; their own geoms stay {_mm(own.smallest)} mm apart")
    apart = f"their own geoms come {_mm(own.largest)} mm apart and {_mm(-own.smallest)} mm into each other"
    warning = f"{names[0]} and {names[1]} can collide, which these shapes cannot tell: give one a tighter shape"
    return Verdict("always", names, f"{reason}; {apart}", warning)


def _neighbours(pair: Pair, proposals: tuple[Proposal, ...], body: BodyModel) -> bool:
    """Whether no link with a shape lies between the second link and the first on the way to the root."""
    shaped = {proposal.link for proposal in proposals}
    above = body.chain_to_root(proposals[pair[1]].link)[1:]
    return next((link for link in above if link in shaped), 0) == proposals[pair[0]].link


def _closest(record: PairRecord) -> str:
    if record.smallest < 0.0:
        return f"at most {_mm(-record.smallest)} mm deep ({_looks(record)})"
    return f"at least {_mm(record.smallest)} mm apart ({_looks(record)})"


def _looks(record: PairRecord) -> str:
    return f"{record.samples} postures" + (f", {record.searches} searches" if record.searches else "")


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.1f}"
