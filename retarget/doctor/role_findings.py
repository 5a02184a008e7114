"""Which of the performer's sensors the sender tells, and which of those can be believed."""

from retarget.catalogue import Kind, entries
from retarget.doctor.finding import Finding, mend, note, ok
from retarget.doctor.listening import Listening
from retarget.errors import RefusedError
from retarget.live.roles import CONVENTIONS, Place
from retarget.live.trust_state import TrustState
from retarget.performer import Performer, load_performer
from retarget.rest_pose import REQUIRED

__all__ = ["UNNAMED", "role_findings"]

UNNAMED = "?"
"""Role of a sensor that neither the performer's file nor the sender's kind names."""
NO_WRISTS = "Let the sender send VMC as well, which has wrists (vmc://:39539)"
"""VRChat's trackers are hip, feet, knees, elbows, chest and head."""
RECENT = 200
"""Frames of which the names are told: Motive's bodies have numbers before they have names."""
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
    TrustState.SWAPPED: ("left and right change places", "Exchange the two trackers' roles at the sender"),
    TrustState.OUT_OF_RANGE: (
        "told to be outside the room (10 m)",
        "Set the sender's origin, its axes and its unit (metres)",
    ),
    TrustState.FROZEN: (
        "repeats one value to the bit while others move",
        "See that its tracker is on and in view; leave out what is not worn (another --performer)",
    ),
}
_LEAST = {TrustState.FROZEN: FROZEN_SHARE}


def role_findings(performer: Performer, convention: str, listening: Listening) -> list[Finding]:
    """convention: by which the performer's sensors are named."""
    if not listening.frames:
        return []
    told, missing = dict[str, Place](), list[tuple[str, Place]]()
    for sensor, place in zip(listening.stream.roles.sensors, listening.stream.roles.places, strict=True):
        if place.position in listening.told:
            told[sensor] = place
        else:
            missing.append((sensor, place))
    found = [_missing(performer, convention, missing, listening)] if missing else []
    doubts = _doubts(told, listening) + _unusable(told, listening)
    doubted = {name for finding in doubts for name in finding.subject.split(", ")}
    good = [] if "sensors" in doubted else [sensor for sensor in told if sensor not in doubted]
    return found + doubts + ([ok("sensors", f"{', '.join(good)} told and believed")] if good else [])


def _missing(performer: Performer, convention: str, missing: list[tuple[str, Place]], listening: Listening) -> Finding:
    names = ", ".join(
        sensor if place.position in (UNNAMED, sensor, "") else f"{sensor} ({place.position})"
        for sensor, place in missing
    )
    if performer.partial and set(REQUIRED).isdisjoint(sensor for sensor, _ in missing):
        return note("sensors", f"the stream tells no {names}: they take no part")
    told = list(dict.fromkeys(name for frame in listening.frames[-RECENT:] for name in frame.names))
    shown = ", ".join(told[:SHOWN]) + (f" and {len(told) - SHOWN} more" if len(told) > SHOWN else "")
    unnamed = any(place.position == UNNAMED for _, place in missing)
    others = _fitting(listening, convention)
    if unnamed and convention == "slimevr_vrchat":
        step = NO_WRISTS
    elif unnamed or (len(missing) == len(performer.sensors) and not others):
        step = f"Name each pose with `role` in the performer's file (a copy of {performer.name})"
    else:
        step = "Switch on, wear and assign what is missing"
    if others:
        step += f", or use --performer {' or '.join(others)}"
    return mend("sensors", f"the stream tells no {names}; it tells {shown}", step)


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


def _doubts(told: dict[str, Place], listening: Listening) -> list[Finding]:
    """What speaks against sensors that are told: a line for all of which the same is to be said."""
    found = []
    for state, (what, step) in _DOUBTS.items():
        shares = {sensor: listening.share(sensor, state) for sensor in told}
        shares = {sensor: share for sensor, share in shares.items() if share > _LEAST.get(state, SOME)}
        if shares:
            worst = f"{100 * max(shares.values()):.0f} % of the time"
            found.append(mend(", ".join(shares), f"{what}, {worst}", step))
    return found


def _unusable(told: dict[str, Place], listening: Listening) -> list[Finding]:
    """Sensors that are told, and of which nothing can be used: each alone, or all of them."""
    unheard = {sensor: _unheard(sensor, place, listening) for sensor, place in told.items()}
    reasons = ", ".join(reason for reason, _ in listening.stream.trust.refused.reasons.most_common(2))
    why = f" ({reasons})" if reasons else ""
    least = min(unheard.values(), default=0.0)
    found = [
        mend(
            sensor,
            f"is told, and cannot be used {100 * share:.0f} % of the time{why}",
            "See that its tracker is seen by the system, and fixed well",
        )
        for sensor, share in unheard.items()
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
