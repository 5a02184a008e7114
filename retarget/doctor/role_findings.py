"""Which of the performer's sensors the sender tells, and which of those can be believed."""

from retarget.catalogue import Kind, entries
from retarget.doctor.finding import Finding, mend, ok
from retarget.doctor.listening import Listening
from retarget.errors import RefusedError
from retarget.frames import mirrored_name
from retarget.live.roles import CONVENTIONS, Place
from retarget.live.trust_state import TrustState
from retarget.performer import Performer, load_performer

__all__ = ["UNNAMED", "role_findings"]

UNNAMED = "?"
"""Role of a sensor that neither the performer's file nor the sender's kind names."""
NO_WRISTS = "Let the sender send VMC as well, which has wrists (vmc://:39539)"
"""VRChat's trackers are hip, feet, knees, elbows, chest and head."""
SHOWN = 30
"""Names of the sender that are listed."""
SOME = 0.02
"""Share of the time from where on a state is worth a word."""
FROZEN_SHARE = 0.1
UNHEARD_SHARE = 0.2

_DOUBTS = {
    TrustState.JUMPED: (
        "jumps farther than a human can",
        "Look for its tracker's view, drift or magnetic fields, and for two senders at once",
    ),
    TrustState.SWAPPED: ("and its other side change places", "Exchange the two trackers' roles at the sender"),
    TrustState.OUT_OF_RANGE: ("is told to be outside the room (10 m)", "Set the sender's origin and its unit (metres)"),
}


def role_findings(performer: Performer, convention: str, listening: Listening) -> list[Finding]:
    """convention: by which the performer's sensors are named."""
    if not listening.frames:
        return []
    roles = listening.stream.roles
    told = listening.told
    missing, found, good = [], list[Finding](), []
    for sensor, place in zip(roles.sensors, roles.places, strict=True):
        if place.position not in told:
            missing.append((sensor, place))
            continue
        doubts = _doubts(sensor, place, listening)
        found += doubts
        if not doubts:
            good.append(sensor)
    unusable = _unusable(listening)
    found += unusable
    doubted = {finding.subject for finding in unusable}
    good = [] if "sensors" in doubted else [sensor for sensor in good if sensor not in doubted]
    if missing:
        found = _missing(performer, convention, missing, listening) + found
    return found + ([ok("sensors", f"{', '.join(good)} told and believed")] if good else [])


def _missing(
    performer: Performer, convention: str, missing: list[tuple[str, Place]], listening: Listening
) -> list[Finding]:
    names = ", ".join(
        sensor if place.position == UNNAMED else f"{sensor} ({place.position})" for sensor, place in missing
    )
    told = list(listening.told)
    shown = ", ".join(told[:SHOWN]) + (f" and {len(told) - SHOWN} more" if len(told) > SHOWN else "")
    steps = ["Switch on, wear and assign what is missing"]
    if any(place.position == UNNAMED for _, place in missing):
        steps = (
            [NO_WRISTS]
            if convention == "slimevr_vrchat"
            else [f"Name each pose with `role` in the performer's file (a copy of {performer.name})"]
        )
    others = _fitting(listening, convention)
    if others:
        steps.append(f"or use --performer {' or '.join(others)}")
    return [mend("sensors", f"the stream tells no {names}; it tells {shown}", ", ".join(steps))]


def _fitting(listening: Listening, convention: str) -> list[str]:
    """Performers by name whose sensors are all told."""
    found = []
    for entry in entries(Kind.PERFORMER):
        try:
            performer = load_performer(entry.path)
        except RefusedError:
            continue
        known = CONVENTIONS.get(performer.roles or convention, {})
        needed = [sensor.role or known.get(name, Place("")).position for name, sensor in performer.sensors.items()]
        if all(name in listening.told for name in needed):
            found.append((len(needed), entry.name))
    return [name for _, name in sorted(found, reverse=True)[:3]]


def _doubts(sensor: str, place: Place, listening: Listening) -> list[Finding]:
    """What speaks against a sensor that is told."""
    found = []
    for state, (what, step) in _DOUBTS.items():
        share = listening.share(sensor, state)
        if share > SOME and not (state is TrustState.SWAPPED and sensor.startswith("r_")):
            subject = f"{sensor}, {mirrored_name(sensor)}" if state is TrustState.SWAPPED else sensor
            found.append(mend(subject, f"{what}, {100 * share:.0f} % of the time", step))
    frozen = listening.share(sensor, TrustState.FROZEN)
    if frozen > FROZEN_SHARE:
        step = f"See that its tracker is on and in view; if it is not worn, leave {sensor} out (--performer)"
        what = f"repeats one value while others move, {100 * frozen:.0f} % of the time ({place.position})"
        found.append(mend(sensor, what, step))
    return found


def _unusable(listening: Listening) -> list[Finding]:
    """Sensors that are told, and of which nothing can be used: each alone, or all of them."""
    told = {
        sensor: _unheard(sensor, place, listening)
        for sensor, place in zip(listening.stream.roles.sensors, listening.stream.roles.places, strict=True)
        if place.position in listening.told
    }
    reasons = ", ".join(reason for reason, _ in listening.stream.trust.refused.reasons.most_common(2))
    why = f" ({reasons})" if reasons else ""
    least = min(told.values(), default=0.0)
    found = [
        mend(
            sensor,
            f"is told, and cannot be used {100 * share:.0f} % of the time{why}",
            "See that its tracker is seen by the system, and fixed well",
        )
        for sensor, share in told.items()
        if share > least + UNHEARD_SHARE
    ]
    if least > UNHEARD_SHARE and reasons:
        step = "See that the system tracks, and that its unit is metres"
        found.append(mend("sensors", f"none can be used {100 * least:.0f} % of the time{why}", step))
    return found


def _unheard(sensor: str, place: Place, listening: Listening) -> float:
    """Share of the time, from when a sensor was first told, in which it was not believed for lack of poses."""
    column = listening.stream.roles.sensors.index(sensor)
    rows = zip(listening.states, listening.looks, strict=True)
    states = [row[column] for row, look in rows if place.position in look]
    return sum(state in (TrustState.STALE, TrustState.NOT_WORN) for state in states) / max(len(states), 1)
