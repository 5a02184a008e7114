"""Capture of a live stream for the doctor, and findings on its sensors, rate, clock, and made-up limbs."""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from hardware.clock import Clock
from retarget import rotations
from retarget.errors import RefusedError
from retarget.human.pose_validation import LIMITS, ValidityState
from retarget.human.rest_pose import REQUIRED
from retarget.live.admission import Datagram, Source
from retarget.live.clock_map import JumpKind, unit_of
from retarget.live.playout import DELAY_CAP_S, smoothing_delay
from retarget.live.roles import CONVENTIONS, PoseSource
from retarget.live.stream import LiveStream
from retarget.schema.catalogue import Kind, entries
from retarget.schema.performer import Performer, load_performer
from retarget.schema.strict_models import listed
from retarget.setup.doctor_machine import DoctorFinding, finding, findings
from retarget.sources.streams.datagram_kinds import Recognised, recognise
from retarget.types import FloatArray, IntArray

STEP_S = 0.01
SAMPLE_S = 0.05
"""Time between two samples of poses and validity, s."""
SETTLING_S = 1.5
MOST_FRAMES = 500_000
MOST_SAMPLES = 12_000
"""Ten minutes of samples."""
MOST_SOURCES = 64
MOST_KINDS = 16
ALL_NAMED = 300
"""Datagrams of which each is recognised. After them, one in SELDOM is, which costs little at 1000 per second."""
SELDOM = 20
MOST_NAMES = 256
"""Most names of sensors, so that a sender cannot fill the memory."""
_UNKNOWN = np.full(7, np.nan)
"""Pose (7,) of a sensor that was not sent."""


@dataclass(frozen=True, slots=True)
class FrameNote:
    """A decoded frame without its poses. arrival: s, local clock; stamp, number: the sender's."""

    arrival: float
    stamp: float | None
    number: int | None
    names: tuple[str, ...]


@dataclass(eq=False)
class StreamCapture:
    """Data of a stream over some seconds. Every field is bounded.

    began, ended: s, clock of the stream. arrived: number of datagrams. sources: datagrams by sender. largest: longest
    datagram by address, bytes. samples: poses (7,) every SAMPLE_S, by the sender's names, m and wxyz. states: a
    ValidityState per sensor at each sample. ages: of the poses that a robot would follow, s.
    """

    stream: LiveStream
    began: float
    ended: float = 0.0
    arrived: int = 0
    sources: Counter[Source] = field(default_factory=Counter)
    largest: dict[str, int] = field(default_factory=dict)
    kinds: Counter[Recognised] = field(default_factory=Counter)
    frames: list[FrameNote] = field(default_factory=list)
    samples: list[dict[str, FloatArray]] = field(default_factory=list)
    states: list[list[int]] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    last_poses: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Duration of the capture, s."""
        return self.ended - self.began

    @property
    def settled(self) -> int:
        """Index of the first sample that is SETTLING_S after the first pose."""
        first = next((row for row, poses in enumerate(self.samples) if poses), len(self.samples))
        return first + round(SETTLING_S / SAMPLE_S)

    def share(self, sensor: str, state: ValidityState) -> float:
        """Share of the time in which a sensor was in a state, 0 to 1, without the time in which trackers settle."""
        states = self.states_of(sensor)[self.settled :]
        return float(np.sum(states == state) / max(len(states), 1))

    def states_of(self, sensor: str) -> IntArray:
        """`ValidityState` (n,) of a sensor at each sample."""
        states = np.array(self.states, dtype=np.int64).reshape(-1, len(self.stream.roles.sensors))
        return np.asarray(states[:, self.stream.roles.sensors.index(sensor)])

    def track(self, name: str) -> FloatArray:
        """Poses (n, 7), m and wxyz, of a name at each sample, NaN before its first one."""
        return np.array([poses.get(name, _UNKNOWN) for poses in self.samples]).reshape(-1, 7)


def capture_stream(stream: LiveStream, *, clock: Clock, seconds: float) -> StreamCapture:
    """Listen for `seconds`, or until a recording ends.

    Every datagram goes to the stream as in a run in which nothing moves.
    """
    capture = StreamCapture(stream, clock.now())
    sample_at = capture.began
    while (now := clock.now()) <= capture.began + seconds and not stream.receiver.finished:
        for datagram in stream.receiver.poll(now):
            _take(capture, datagram, now)
        if now >= sample_at:
            sample_at += SAMPLE_S
            states, shown = stream.validity.judge(now), np.fmax.reduce(stream.playout.read(now).time)
            if len(capture.states) < MOST_SAMPLES:
                capture.ages += [now - float(shown)] if np.isfinite(shown) else []
                capture.states.append(states.tolist())
                capture.samples.append(dict(capture.last_poses))
        clock.sleep_until(now + STEP_S)
    capture.ended = clock.now()
    return capture


def _take(capture: StreamCapture, datagram: Datagram, now: float) -> None:
    stream = capture.stream
    capture.arrived += 1
    if datagram.source in capture.sources or len(capture.sources) < MOST_SOURCES:
        capture.sources[datagram.source] += 1
        host, size = datagram.source[0], len(datagram.payload)
        capture.largest[host] = max(size, capture.largest.get(host, 0))
    if capture.arrived <= ALL_NAMED or capture.arrived % SELDOM == 0:
        got = recognise(datagram.payload)
        if got not in capture.kinds and len(capture.kinds) >= MOST_KINDS:
            got = replace(got, detail="and others")
        capture.kinds[got] += 1
    if not stream.admission.admit(datagram, now=now, moving=False):
        return
    for frame in stream.take(datagram, now, moving=False):
        if len(capture.frames) < MOST_FRAMES:
            capture.frames.append(FrameNote(datagram.arrival, frame.stamp, frame.number, frame.names))
        for name, place, turn in zip(frame.names, frame.position, frame.orientation, strict=True):
            if name in capture.last_poses or len(capture.last_poses) < MOST_NAMES:
                # Some senders split a pose over two datagrams: its missing half is that of the pose before.
                pose = np.concatenate((place, turn))
                capture.last_poses[name] = np.where(np.isnan(pose), capture.last_poses.get(name, _UNKNOWN), pose)


# The performer's sensors: those that are sent, missing, or in a wrong state.

OLD_MS = 60.0
"""Age of poses, ms, from which on a person sees that the robot is behind: half of what its servos take."""
UNNAMED = "?"
"""Role of a sensor that neither the performer's file nor the sender's kind names."""
RECENT = 200
"""Last frames whose names are listed: Motive's bodies have numbers before they have names."""
UNUSABLE_SHARE = 0.2
"""Share of the time from which on a sensor without a valid pose is reported."""
_WRONG_SHARES = {
    ValidityState.JUMPED: 0.02,
    ValidityState.OUT_OF_RANGE: 0.02,
    ValidityState.FROZEN: 0.1,
}
"""Share of the time from which on a state is reported."""


def role_findings(performer: Performer, convention: str, capture: StreamCapture) -> list[DoctorFinding]:
    """Findings on the performer's sensors. convention: by which they are named."""
    if not capture.frames:
        return []
    sent, missing = dict[str, PoseSource](), list[tuple[str, PoseSource]]()
    for sensor, place in zip(capture.stream.roles.sensors, capture.stream.roles.places, strict=True):
        if place.position in capture.last_poses:
            sent[sensor] = place
        else:
            missing.append((sensor, place))
    found = [_missing(performer, convention, missing, capture)] if missing else []
    wrong = []
    for state, least in _WRONG_SHARES.items():
        shares = {sensor: share for sensor in sent if (share := capture.share(sensor, state)) > least}
        if shares:
            worst = 100 * max(shares.values())
            wrong.append(finding(f"sensors/{state.name}", subject=", ".join(shares), percent=worst))
    wrong += _unusable(sent, capture)
    affected = {name for one in wrong for name in one.subject.split(", ")}
    good = [] if "sensors" in affected else [sensor for sensor in sent if sensor not in affected]
    return found + wrong + ([finding("sensors", sensors=", ".join(good))] if good else [])


def _missing(
    performer: Performer, convention: str, missing: list[tuple[str, PoseSource]], capture: StreamCapture
) -> DoctorFinding:
    names = ", ".join(
        sensor if place.position in (UNNAMED, sensor, "") else f"{sensor} ({place.position})"
        for sensor, place in missing
    )
    if performer.partial and set(REQUIRED).isdisjoint(sensor for sensor, _ in missing):
        return finding("sensors/no part", names=names)
    sent = dict.fromkeys(name for frame in capture.frames[-RECENT:] for name in frame.names)
    unnamed = any(place.position == UNNAMED for _, place in missing)
    fitting = []  # performers whose sensors are all in the stream, and how many these are
    for entry in entries(Kind.PERFORMER):
        try:
            other = load_performer(entry.path)
        except RefusedError:
            continue
        known = CONVENTIONS.get(other.roles or convention, {})
        needed = [sensor.role or known.get(name, PoseSource("")).position for name, sensor in other.sensors.items()]
        if all(name in capture.last_poses for name in needed):
            fitting.append((len(needed), entry.name))
    others = " or ".join(name for _, name in sorted(fitting, reverse=True)[:3])
    return finding(
        "sensors/missing",
        names=names,
        sent=listed(sent),
        wristless=unnamed and convention == "slimevr_vrchat",
        unnamed=unnamed or (len(missing) == len(performer.sensors) and not others),
        performer=performer.name,
        others=f", or use --performer {others}" if others else "",
    )


def _unusable(sent: dict[str, PoseSource], capture: StreamCapture) -> list[DoctorFinding]:
    unusable = {}  # sensor -> share of the time since its first pose in which it had no valid pose, 0 to 1
    for sensor, place in sent.items():
        states = capture.states_of(sensor)[[place.position in poses for poses in capture.samples]]
        lost = np.isin(states, (ValidityState.STALE, ValidityState.NOT_IN_USE)).sum()
        unusable[sensor] = float(lost / max(len(states), 1))
    reasons = ", ".join(reason for reason, _ in capture.stream.validity.refused.reasons.most_common(2))
    why = f" ({reasons})" if reasons else ""
    least = min(unusable.values(), default=0.0)
    found = [
        finding("sensors/unusable", subject=sensor, percent=100 * share, why=why)
        for sensor, share in unusable.items()
        if share > least + UNUSABLE_SHARE
    ]
    if least > UNUSABLE_SHARE and reasons:
        found.append(finding("sensors/none usable", percent=100 * least, why=why))
    return found


# Rate, jitter, gaps, loss by frame numbers, and the sender's clock.

SLOWEST_HZ = 1.0 / DELAY_CAP_S
"""Least rate with a frame on both sides of the playout time, Hz."""
FEW = 5
"""Fewest frames for a finding."""

_JUMPS = {
    JumpKind.RESTARTED: "it was restarted",
    JumpKind.FORWARD: "it jumped forward",
    JumpKind.BACK: "it jumped back, or the network's delay grew",
}


def rate_findings(kind: str, capture: StreamCapture) -> list[DoctorFinding]:
    """Findings on the frames of the performer's most frequent sensor, else on all frames. Some senders put each sensor
    into its own datagram."""
    known = [name for name in capture.stream.roles.names if name in capture.last_poses]
    of_each = [[frame for frame in capture.frames if name in frame.names] for name in known]
    frames = max(of_each, key=len, default=capture.frames)
    if len(frames) < FEW:
        return findings("rate/few", count=len(frames))
    arrivals = np.array([frame.arrival for frame in frames])
    gaps, seconds = np.diff(arrivals), float(arrivals[-1] - arrivals[0])
    p50, p99 = 1e3 * np.percentile(np.abs(gaps - np.median(gaps)), (50, 99))
    found = findings(
        "rate",
        "jitter",
        "gaps",
        "gaps/end",
        rate=len(gaps) / max(seconds, 1e-9),
        slowest=SLOWEST_HZ,
        p50=p50,
        p99=p99,
        most=1e3 * DELAY_CAP_S,
        longest_ms=1e3 * gaps.max(),
        count=np.count_nonzero(gaps > LIMITS.silent_after),
        silence=LIMITS.silent_after,
        longest=gaps.max(),
        quiet=0.0 if capture.stream.receiver.finished else capture.ended - capture.frames[-1].arrival,
        usual=max(LIMITS.silent_after, 3.0 * float(np.median(gaps))),
    )
    if capture.ages:
        smoothed = smoothing_delay(capture.stream.smoothing, 1.0)
        found += findings("latency", old=1e3 * np.median(capture.ages), smoothed=1e3 * smoothed, most=OLD_MS)
    return found + _loss(kind, frames) + _clock(kind, frames, capture, seconds)


def _loss(kind: str, frames: list[FrameNote]) -> list[DoctorFinding]:
    """Findings on the sender's frame numbers. MVN leaves some out on purpose."""
    numbers = np.array([frame.number for frame in frames if frame.number is not None], dtype=float)
    if len(numbers) < FEW:
        return []
    steps = np.diff(numbers)
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if len(forward) else 1.0
    missing = float(np.sum(np.maximum(np.round(steps / usual) - 1.0, 0.0)))
    everything = missing + len(numbers)
    facts = {"missing": missing, "all": everything, "percent": 100.0 * missing / everything, "meant": kind == "mvn"}
    return findings("order", "order/still", "loss", back=np.sum(steps < 0), forward=len(forward), **facts)


def _clock(kind: str, frames: list[FrameNote], capture: StreamCapture, seconds: float) -> list[DoctorFinding]:
    """Findings on a sender's clock that stands still, runs at another speed, jumps, or is coarse."""
    clock, jump = capture.stream.clock_map, capture.stream.clock_map.last_jump
    stamped = [(frame.stamp, frame.arrival) for frame in frames if frame.stamp is not None]
    if len(stamped) < FEW:
        return findings("clock/none")
    stamps, at = np.array(stamped).T
    # The sender's seconds per local second: a median over an eighth of the time, which jumps do not change.
    lag, reasons = max(len(stamps) // 8, 1), clock.dropped.reasons
    speed = float(np.median((stamps[lag:] - stamps[:-lag]) / np.maximum(at[lag:] - at[:-lag], 1e-9)))
    return findings(
        "clock",
        distinct=len(np.unique(stamps)),
        fast=speed if unit_of(speed) else 0.0,
        unit=unit_of(speed),
        skew=abs(speed - 1.0),
        second=1.0 / max(speed, 1e-9),
        local=at[-1] - at[0],
        seconds=seconds,
        jumps=clock.jumps,
        often="once" if clock.jumps == 1 else f"{clock.jumps} times, the last time",
        shift=0.0 if jump is None else abs(jump.shift),
        how="" if jump is None else _JUMPS[jump.kind],
        ms=1e3 * float(np.spacing(np.float32(stamps[-1]))) if kind == "vmc" else 0.0,
        late=sum(reasons[reason] for reason in ("late", "stamped ahead", "out of order")) / len(frames),
        reasons=", ".join(f"{reason} ({count})" for reason, count in reasons.most_common(3)),
    )


# Limbs that a sender makes up, which are rigid in the trunk's frame. SlimeVR sends arms and hands without a tracker.
# Nothing on the wire marks them (facts on streams, section 2).

RIGID_M = 1e-3
"""Largest range of a made-up limb in the trunk's frame, m. A real limb moves more while the trunk moves."""
MOVED_M, MOVED_RAD = 0.05, 0.15
"""Least motion of the trunk for a finding."""
STEP_M, STEP_RAD = 0.001, 0.002
LEAST_STEPS = 10
"""Fewest samples in which the trunk moved, more than in a reset of the trackers."""
LEAST_SAMPLES = 20
_CARRIERS = {"chest": ("wrist", "elbow"), "pelvis": ("ankle", "knee")}
"""Parts of the trunk, and the limbs on them."""


def invented_findings(convention: str, capture: StreamCapture) -> list[DoctorFinding]:
    """Findings on sensors that the sender makes up, if it sends a trunk; a note if no sensor moved."""
    known = CONVENTIONS.get(convention, {})
    if not capture.frames or len(capture.samples) < LEAST_SAMPLES:
        return []
    if not any(_moves(capture.track(name)) for name in capture.last_poses):
        return [finding("sensors/still")]
    found = []
    for carrier, limbs in _CARRIERS.items():
        if carrier not in known:
            continue
        for sensor, place in zip(capture.stream.roles.sensors, capture.stream.roles.places, strict=True):
            if sensor[2:] in limbs and _moves_with(place, known[carrier], capture):
                facts = {"carrier": carrier, "name": place.position, "sensor": sensor}
                found.append(finding("sensors/made up", subject=sensor, **facts))
    return found


def _moves(track: FloatArray) -> bool:
    places, turns = track[np.isfinite(track[:, 0]), :3], track[np.isfinite(track[:, 3]), 3:]
    gone = len(places) > 1 and float(np.ptp(places, axis=0).max()) > MOVED_M
    return gone or (len(turns) > 1 and _turned(turns) > MOVED_RAD)


def _turned(turns: FloatArray) -> float:
    """Largest angle between orientations (n, 4) and the first, rad."""
    return float(rotations.angle_between(turns, np.broadcast_to(turns[0], turns.shape)).max())


def _moves_with(limb: PoseSource, trunk: PoseSource, capture: StreamCapture) -> bool:
    """True if a limb is rigid in the trunk's frame while the trunk moves."""
    rows = [capture.track(trunk.position)[:, :3], capture.track(trunk.orientation)[:, 3:]]
    both = np.hstack([capture.track(limb.position)[:, :3], *rows])[capture.settled :]
    both = both[np.isfinite(both).all(axis=1)]
    if len(both) < LEAST_SAMPLES:
        return False
    place, base, turn = both[:, :3], both[:, 3:6], both[:, 6:]
    if np.ptp(base, axis=0).max() < MOVED_M and _turned(turn) < MOVED_RAD:
        return False
    moving = (np.linalg.norm(np.diff(base, axis=0), axis=1) > STEP_M) | (
        rotations.angle_between(turn[1:], turn[:-1]) > STEP_RAD
    )
    if np.count_nonzero(moving) < LEAST_STEPS:
        return False
    in_trunk = rotations.rotate(rotations.conjugate(turn), place - base)
    return bool(np.ptp(in_trunk, axis=0).max() < RIGID_M)
