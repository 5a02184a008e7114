"""The doctor looks at what a stream says: its rate, its sensors, and limbs that a sender makes up."""

import numpy as np

from retarget import rotations
from retarget.errors import RefusedError
from retarget.human.rest_pose import REQUIRED
from retarget.live.clock_map import JumpKind
from retarget.live.performer import SILENCE_S
from retarget.live.playout import DELAY_CAP_S
from retarget.live.roles import CONVENTIONS, Place
from retarget.live.sensor_validity import ValidityState
from retarget.schema.catalogue import Kind, entries
from retarget.schema.performer import Performer, load_performer
from retarget.setup.doctor_listening import FrameNote, Listening
from retarget.setup.doctor_machine import Finding, fix, note, ok
from retarget.types import FloatArray

__all__ = ["UNNAMED", "invented_findings", "rate_findings", "role_findings"]


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
    ValidityState.JUMPED: (
        "jumps farther than a human can",
        "Look for its tracker's view, drift or magnetic fields, and for two senders at once",
    ),
    ValidityState.SWAPPED: ("left and right change places", "Exchange the two trackers' roles at the sender"),
    ValidityState.OUT_OF_RANGE: (
        "told to be outside the room (10 m)",
        "Set the sender's origin, its axes and its unit (metres)",
    ),
    ValidityState.FROZEN: (
        "repeats one value to the bit while others move",
        "See that its tracker is on and in view; leave out what is not worn (another --performer)",
    ),
}
_LEAST = {ValidityState.FROZEN: FROZEN_SHARE}


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
    return fix("sensors", f"the stream tells no {names}; it tells {shown}", step)


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
            found.append(fix(", ".join(shares), f"{what}, {worst}", step))
    return found


def _unusable(told: dict[str, Place], listening: Listening) -> list[Finding]:
    """Sensors that are told, and of which nothing can be used: each alone, or all of them."""
    unheard = {sensor: _unheard(sensor, place, listening) for sensor, place in told.items()}
    reasons = ", ".join(reason for reason, _ in listening.stream.validity.refused.reasons.most_common(2))
    why = f" ({reasons})" if reasons else ""
    least = min(unheard.values(), default=0.0)
    found = [
        fix(
            sensor,
            f"is told, and cannot be used {100 * share:.0f} % of the time{why}",
            "See that its tracker is seen by the system, and fixed well",
        )
        for sensor, share in unheard.items()
        if share > least + UNHEARD_SHARE
    ]
    if least > UNHEARD_SHARE and reasons:
        step = "See that the system tracks, and that its unit is metres"
        found.append(fix("sensors", f"none can be used {100 * least:.0f} % of the time{why}", step))
    return found


def _unheard(sensor: str, place: Place, listening: Listening) -> float:
    """Share of the time, from when a sensor was first told, in which it was not believed for lack of poses."""
    column = listening.stream.roles.sensors.index(sensor)
    rows = zip(listening.states, listening.looks, strict=True)
    states = [row[column] for row, look in rows if place.position in look]
    return sum(state in (ValidityState.STALE, ValidityState.NOT_IN_USE) for state in states) / max(len(states), 1)


# How often and how evenly frames come, what is lost by their numbers, and what the sender's clock does.

SLOWEST_HZ = 1.0 / DELAY_CAP_S
"""Below it there is not always a frame on both sides of the time that is played."""
GOOD_HZ = 50.0
FEW = 5
"""Frames from which on something can be said."""
LOST_SHARE = 0.01
SKEW = 0.02
"""By which a sender's seconds may differ from ours; a real clock is off by less than 0.0002."""
SKEW_S = 3.0
"""So long must have been listened for that."""
COARSE_S = 0.002

_JUMPS = {
    JumpKind.RESTARTED: "it was restarted",
    JumpKind.FORWARD: "it leapt forward",
    JumpKind.BACK: "it leapt back, or the network's delay grew",
}


def rate_findings(kind: str, listening: Listening) -> list[Finding]:
    """Of the frames that tell the performer's sensors, where any does; else of all."""
    frames = _of_one_sensor(listening)
    if len(frames) < FEW:
        return [] if not frames else [fix("rate", f"only {len(frames)} frames came", "Let the sender go on sending")]
    arrivals = np.array([frame.arrival for frame in frames])
    gaps = np.diff(arrivals)
    found = [_rate(arrivals), _jitter(gaps), *_silences(gaps, listening)]
    return found + _loss(kind, frames) + _clock(kind, frames, arrivals, listening)


def _of_one_sensor(listening: Listening) -> list[FrameNote]:
    """Frames that tell the sensor that is told most often: some senders tell each in a datagram of its own."""
    wanted = [name for name in listening.stream.roles.names if name in listening.told]
    told = {name: [frame for frame in listening.frames if name in frame.names] for name in wanted}
    return max(told.values(), key=len) if told else listening.frames


def _rate(arrivals: FloatArray) -> Finding:
    rate = (len(arrivals) - 1) / max(float(arrivals[-1] - arrivals[0]), 1e-9)
    told = f"{rate:.0f} frames/s"
    if rate < SLOWEST_HZ:
        step = "Raise the sender's rate to 60 or more; look at Wi-Fi and at the trackers' own rate"
        return fix("rate", f"{told}, fewer than the {SLOWEST_HZ:.0f} that are needed", step)
    if rate < GOOD_HZ:
        return note("rate", f"{told}: enough; from {GOOD_HZ:.0f} on, motion is delayed less")
    return ok("rate", told)


def _jitter(gaps: FloatArray) -> Finding:
    typical = float(np.median(gaps))
    p50, p99 = np.percentile(np.abs(gaps - typical), (50, 99))
    told = f"p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms, longest gap {1e3 * gaps.max():.0f} ms"
    if p99 > DELAY_CAP_S:
        step = "Use a cable, or a Wi-Fi of its own near the performer; end what else loads the sender"
        return fix("jitter", f"{told}: more than the {1e3 * DELAY_CAP_S:.0f} ms that are evened out", step)
    return ok("jitter", told)


def _silences(gaps: FloatArray, listening: Listening) -> list[Finding]:
    """Gaps in which a robot would have held."""
    count = int(np.count_nonzero(gaps > SILENCE_S))
    found = []
    if count:
        step = "Look at Wi-Fi, at power saving of the trackers, and at what else the sender's computer does"
        told = f"{count} gaps longer than {SILENCE_S:g} s, the longest {gaps.max():.2f} s: a robot holds in each"
        found.append(fix("gaps", told, step))
    quiet = listening.ended - listening.frames[-1].arrival
    if quiet > max(SILENCE_S, 3.0 * float(np.median(gaps))) and not getattr(listening.stream.receiver, "finished", 0):
        found.append(fix("gaps", f"silent for the last {quiet:.1f} s", "See whether the sender stopped"))
    return found


def _loss(kind: str, frames: list[FrameNote]) -> list[Finding]:
    """By the sender's frame numbers, of which MVN leaves some out on purpose."""
    numbers = np.array([frame.number for frame in frames if frame.number is not None], dtype=float)
    if len(numbers) < FEW:
        return []
    steps = np.diff(numbers)
    found = []
    back = int(np.count_nonzero(steps < 0))
    if back:
        step = "Several in a row come of two senders or of Wi-Fi; what is overtaken is sorted in or dropped"
        found.append(note("order", f"{back} frames came after a later one", step))
    if not np.count_nonzero(steps > 0):
        return [*found, fix("order", "the frame number stands still", "Let the sender count its frames, or tell none")]
    usual = float(np.median(steps[steps > 0]))
    missing = float(np.sum(np.maximum(np.round(steps / usual) - 1.0, 0.0)))
    share = missing / (missing + len(numbers))
    told = f"{missing:.0f} of {missing + len(numbers):.0f} frames by their numbers ({100 * share:.1f} %)"
    if kind == "mvn":
        found.append(ok("loss", told + ", some of which MVN leaves out itself"))
    elif share > LOST_SHARE:
        found.append(fix("loss", told, "Use a cable, not Wi-Fi; see that nothing else fills the network"))
    else:
        found.append(ok("loss", told))
    return found


def _clock(kind: str, frames: list[FrameNote], arrivals: FloatArray, listening: Listening) -> list[Finding]:
    """Leaps, a clock that stands, one that runs at another speed, one that has become coarse."""
    clock = listening.stream.clock_map
    told = [(frame.stamp, frame.arrival) for frame in frames if frame.stamp is not None]
    if len(told) < FEW:
        return [ok("clock", "the sender tells no time: arrivals count")]
    stamps, at = (np.array(column) for column in zip(*told, strict=True))
    if len(np.unique(stamps)) == 1:
        step = "Let the sender stamp each frame, or tell no time at all"
        return [fix("clock", "the sender's time stands still", step)]
    speed = _speed(stamps, at)
    if at[-1] - at[0] > SKEW_S and abs(speed - 1.0) > SKEW:
        step = "Let it send seconds of a steady clock; a recording must be played at its own speed"
        return [fix("clock", f"the sender's second lasts {1.0 / max(speed, 1e-9):.2f} of ours", step)]
    if clock.jumps and clock.last_jump is not None:
        step = "Let only one sender run; switch off what sets its clock, or let it send a steady one"
        how = _JUMPS[clock.last_jump.kind]
        shift = abs(clock.last_jump.shift)
        often = "once" if clock.jumps == 1 else f"{clock.jumps} times, the last time"
        return [fix("clock", f"the sender's clock leapt {often} by {shift:.3f} s: {how}", step)]
    coarse = float(np.spacing(np.float32(stamps[-1]))) if kind == "vmc" else 0.0
    if coarse > COARSE_S:
        step = "Restart the sender: it tells seconds in single precision, which grow coarse in hours"
        return [fix("clock", f"the sender's time goes in steps of {1e3 * coarse:.0f} ms", step)]
    late = sum(clock.dropped.reasons[reason] for reason in ("late", "stamped ahead", "out of order"))
    if late > LOST_SHARE * len(frames):
        reasons = ", ".join(f"{reason} ({count})" for reason, count in clock.dropped.reasons.most_common(3))
        return [fix("clock", f"frames that come too late to be used: {reasons}", "Use a cable, not Wi-Fi")]
    return [ok("clock", f"no leap in {arrivals[-1] - arrivals[0]:.1f} s")]


def _speed(stamps: FloatArray, at: FloatArray) -> float:
    """Seconds of the sender in one of ours: the median over an eighth of the time, which leaps do not change."""
    lag = max(len(stamps) // 8, 1)
    ours = at[lag:] - at[:-lag]
    return float(np.median((stamps[lag:] - stamps[:-lag]) / np.maximum(ours, 1e-9)))


# Limbs that a sender makes up: they hang from the trunk, to the millimetre, however the trunk goes.
#
# SlimeVR tells arms and hands that nobody tracks; nothing on the wire marks them (facts on streams, section 2).

RIGID_M = 1e-3
"""A limb that a person carries is never so still within the trunk while the trunk goes."""
MOVED_M, MOVED_RAD = 0.05, 0.15
"""So far must the trunk have gone, or turned, to say anything."""
STEP_M, STEP_RAD = 0.001, 0.002
LEAST_STEPS = 10
"""Looks between which the trunk went on: a reset of the trackers takes the whole body along at once."""
LEAST_LOOKS = 20
_CARRIERS = {"chest": ("wrist", "elbow"), "pelvis": ("ankle", "knee")}
"""Parts of the trunk and the limbs that hang from them."""


def invented_findings(convention: str, listening: Listening) -> list[Finding]:
    """Of the performer's sensors; nothing where the sender tells no trunk. A note where nobody moved at all."""
    known = CONVENTIONS.get(convention, {})
    if not listening.frames or len(listening.looks) < LEAST_LOOKS:
        return []
    if not any(_moves(_track(listening, name)) for name in listening.told):
        step = "Walk and turn while the doctor listens: frozen and made-up sensors show only then"
        return [note("sensors", "nobody moved", step)]
    found = []
    for carrier, limbs in _CARRIERS.items():
        if carrier not in known:
            continue
        for sensor, place in zip(listening.stream.roles.sensors, listening.stream.roles.places, strict=True):
            if sensor[2:] in limbs and _hangs(place, known[carrier], listening):
                what = f"hangs from the {carrier} as if nobody tracked it: the sender makes it up ({place.position})"
                step = f"Wear and assign a tracker there, or leave {sensor} out (another --performer)"
                found.append(fix(sensor, what, step))
    return found


def _track(listening: Listening, name: str) -> FloatArray:
    """Poses (n, 7) of a name, at the looks at which it is known."""
    return np.array([look[name] for look in listening.looks if name in look]).reshape(-1, 7)


def _moves(track: FloatArray) -> bool:
    """Whether poses (n, 7) go or turn by so much that somebody must be moving."""
    places, turns = track[np.isfinite(track[:, 0]), :3], track[np.isfinite(track[:, 3]), 3:]
    gone = len(places) > 1 and float(np.ptp(places, axis=0).max()) > MOVED_M
    return gone or (len(turns) > 1 and _turned(turns) > MOVED_RAD)


def _turned(turns: FloatArray) -> float:
    """How far orientations (n, 4) are from the first at most, rad."""
    return float(rotations.angle_between(turns, np.broadcast_to(turns[0], turns.shape)).max())


def _hangs(limb: Place, trunk: Place, listening: Listening) -> bool:
    both = [
        (look[limb.position], look[trunk.position], look[trunk.orientation])
        for look in listening.looks[listening.settled :]
        if limb.position in look and trunk.position in look and trunk.orientation in look
    ]
    if len(both) < LEAST_LOOKS:
        return False
    rows = np.array(both)
    place, base, turn = rows[:, 0, :3], rows[:, 1, :3], rows[:, 2, 3:]
    sound = np.isfinite(np.concatenate((place, base, turn), axis=1)).all(axis=1)
    place, base, turn = place[sound], base[sound], turn[sound]
    if len(place) < LEAST_LOOKS:
        return False
    if np.ptp(base, axis=0).max() < MOVED_M and _turned(turn) < MOVED_RAD:
        return False
    went = (np.linalg.norm(np.diff(base, axis=0), axis=1) > STEP_M) | (
        rotations.angle_between(turn[1:], turn[:-1]) > STEP_RAD
    )
    if np.count_nonzero(went) < LEAST_STEPS:
        return False
    inside = rotations.rotate(rotations.conjugate(turn), place - base)
    return bool(np.ptp(inside, axis=0).max() < RIGID_M)
