"""How often and how evenly frames come, what is lost by their numbers, and what the sender's clock does."""

import numpy as np

from retarget.doctor.finding import Finding, mend, note, ok
from retarget.doctor.listening import FrameNote, Listening
from retarget.live.clock_jump import JumpKind
from retarget.live.performer import SILENCE_S
from retarget.live.playout_delay import DELAY_CAP_S
from retarget.rotations import FloatArray

__all__ = ["rate_findings"]

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

_LEAPS = {
    JumpKind.RESTARTED: "it was restarted",
    JumpKind.FORWARD: "it leapt forward",
    JumpKind.BACK: "it leapt back, or the network's delay grew",
}


def rate_findings(kind: str, listening: Listening) -> list[Finding]:
    """Of the frames that tell the performer's sensors, where any does; else of all."""
    frames = _of_one_sensor(listening)
    if len(frames) < FEW:
        return [] if not frames else [mend("rate", f"only {len(frames)} frames came", "Let the sender go on sending")]
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
        return mend("rate", f"{told}, fewer than the {SLOWEST_HZ:.0f} that are needed", step)
    if rate < GOOD_HZ:
        return note("rate", f"{told}: enough; from {GOOD_HZ:.0f} on, motion is delayed less")
    return ok("rate", told)


def _jitter(gaps: FloatArray) -> Finding:
    typical = float(np.median(gaps))
    p50, p99 = np.percentile(np.abs(gaps - typical), (50, 99))
    told = f"p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms, longest gap {1e3 * gaps.max():.0f} ms"
    if p99 > DELAY_CAP_S:
        step = "Use a cable, or a Wi-Fi of its own near the performer; end what else loads the sender"
        return mend("jitter", f"{told}: more than the {1e3 * DELAY_CAP_S:.0f} ms that are evened out", step)
    return ok("jitter", told)


def _silences(gaps: FloatArray, listening: Listening) -> list[Finding]:
    """Gaps in which a robot would have held."""
    count = int(np.count_nonzero(gaps > SILENCE_S))
    found = []
    if count:
        step = "Look at Wi-Fi, at power saving of the trackers, and at what else the sender's computer does"
        told = f"{count} gaps longer than {SILENCE_S:g} s, the longest {gaps.max():.2f} s: a robot holds in each"
        found.append(mend("gaps", told, step))
    quiet = listening.ended - listening.frames[-1].arrival
    if quiet > max(SILENCE_S, 3.0 * float(np.median(gaps))) and not getattr(listening.stream.receiver, "finished", 0):
        found.append(mend("gaps", f"silent for the last {quiet:.1f} s", "See whether the sender stopped"))
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
        return [*found, mend("order", "the frame number stands still", "Let the sender count its frames, or tell none")]
    usual = float(np.median(steps[steps > 0]))
    missing = float(np.sum(np.maximum(np.round(steps / usual) - 1.0, 0.0)))
    share = missing / (missing + len(numbers))
    told = f"{missing:.0f} of {missing + len(numbers):.0f} frames by their numbers ({100 * share:.1f} %)"
    if kind == "mvn":
        found.append(ok("loss", told + ", some of which MVN leaves out itself"))
    elif share > LOST_SHARE:
        found.append(mend("loss", told, "Use a cable, not Wi-Fi; see that nothing else fills the network"))
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
        return [mend("clock", "the sender's time stands still", step)]
    speed = _speed(stamps, at)
    if at[-1] - at[0] > SKEW_S and abs(speed - 1.0) > SKEW:
        step = "Let it send seconds of a steady clock; a recording must be played at its own speed"
        return [mend("clock", f"the sender's second lasts {1.0 / max(speed, 1e-9):.2f} of ours", step)]
    if clock.jumps and clock.last_jump is not None:
        step = "Let only one sender run; switch off what sets its clock, or let it send a steady one"
        how = _LEAPS[clock.last_jump.kind]
        shift = abs(clock.last_jump.shift)
        often = "once" if clock.jumps == 1 else f"{clock.jumps} times, the last time"
        return [mend("clock", f"the sender's clock leapt {often} by {shift:.3f} s: {how}", step)]
    coarse = float(np.spacing(np.float32(stamps[-1]))) if kind == "vmc" else 0.0
    if coarse > COARSE_S:
        step = "Restart the sender: it tells seconds in single precision, which grow coarse in hours"
        return [mend("clock", f"the sender's time goes in steps of {1e3 * coarse:.0f} ms", step)]
    late = sum(clock.dropped.reasons[reason] for reason in ("late", "stamped ahead", "out of order"))
    if late > LOST_SHARE * len(frames):
        reasons = ", ".join(f"{reason} ({count})" for reason, count in clock.dropped.reasons.most_common(3))
        return [mend("clock", f"frames that come too late to be used: {reasons}", "Use a cable, not Wi-Fi")]
    return [ok("clock", f"no leap in {arrivals[-1] - arrivals[0]:.1f} s")]


def _speed(stamps: FloatArray, at: FloatArray) -> float:
    """Seconds of the sender in one of ours: the median over an eighth of the time, which leaps do not change."""
    lag = max(len(stamps) // 8, 1)
    ours = at[lag:] - at[:-lag]
    return float(np.median((stamps[lag:] - stamps[:-lag]) / np.maximum(ours, 1e-9)))
