"""Reports on a stream: why it cannot be used, messages while it runs, and the report after the run."""

import shlex
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address
from itertools import islice

import numpy as np

from retarget.errors import InputError, Problem
from retarget.human.pose_validation import StateArray, ValidityState
from retarget.live.address import KINDS, for_others, parse_address
from retarget.live.admission import NEW_SOCKETS, NOT_ALLOWED, SECOND_SOURCE, TOO_LONG, TOO_MANY, Source
from retarget.live.clock_map import FASTER, JumpKind, not_seconds
from retarget.live.datagram_kinds import advice_for, reads, recognise
from retarget.live.natnet_session import NEWEST, natnet_problems
from retarget.live.receivers import NatnetReceiver, UdpReceiver
from retarget.live.sensor_validity import OUT_OF_RANGE
from retarget.live.stream import LiveStream
from retarget.sources.streams.json_pose import TIME_IN_MS
from retarget.sources.streams.mvn import MvnDecoder
from retarget.sources.streams.natnet_wire import OLDEST
from retarget.types import Notify

NOTED_S = 0.05
"""Time, s, without a frame after which counts are noted: what arrives from then on arrives instead of frames."""
SILENT_S = 1.0
"""Time without a frame after which the reason is reported."""
NATNET_S = 2.5
"""The same where Motive is asked first."""
MOST_REASONS, MOST_NAMES = 3, 40
SENDER = "See that the sender speaks the protocol of this address"
SWITCH_ON = "Wear and switch on these, or choose another --performer"
FAR = "See in which unit the sender sends lengths, and where its origin is: sensors must be within 10 m of it"
REPLAY = "replay"
OVER, LONGER = "the recording was over {:.1f} s ago", "Take a longer one"
"""Message and next step for a recording that ends too soon."""
OWNER_SILENT = (
    "{}, which was first, is silent, and no other sender may take its place while a robot may move: let it send again, "
    "or end this run and start it anew"
)
"""To be filled with the owner of the stream."""
IN_SECONDS = "Let the sender send its time in seconds"
STEPS = {
    NEW_SOCKETS: "Let it keep one socket for all datagrams",
    TIME_IN_MS: IN_SECONDS,
    **{not_seconds(unit): IN_SECONDS for unit in FASTER.values()},
}
"""The next step, by a reason that a sender's mistake in every datagram has."""
QUATERNIONS = "In MVN's network streamer choose Position + Orientation (Quaternion)"


def unusable(stream: LiveStream, missing: list[str], waited: float, *, where: str, now: float) -> InputError:
    """Make the error for a stream that cannot be used, with the reason. missing: needed sensors that are not fresh."""
    problems, refused = _motive(stream, now), _refused(stream)
    silence, reasons = now - stream.last, _listed(refused)
    if problems:
        return InputError.from_problems(problems)
    if stream.arrived == 0:
        return _nothing(stream, waited, where=where)
    if stream.frames == 0:
        other, step = _something_else(stream, where)
        found = f"{stream.arrived} datagrams: {other or reasons or 'no poses in them'}"
        return InputError(
            "what arrives cannot be used", where=where, found=found, next_step=step or _step(stream, refused)
        )
    if _commonest(refused) in STEPS:
        step = _step(stream, refused)
        return InputError("what arrives cannot be used", where=where, found=reasons, next_step=step)
    if silence >= 0.5 * SILENT_S and stream.receiver.finished:
        return InputError(OVER.format(silence), where=where, next_step=LONGER)
    if silence >= 0.5 * SILENT_S:
        return InputError(
            f"nothing has arrived for {silence:.1f} s, and before that {stream.frames} frames",
            where=where,
            found=", ".join(f"no {name}" for name in missing),
            next_step="See that the sender still runs, and sends here",
        )
    sent = dict(zip(stream.roles.sensors, stream.roles.places, strict=True))
    return InputError(
        "sensors are missing in the stream",
        where=where,
        found=", ".join(f"no {name} ({sent[name].position})" for name in missing)
        + (f"; refused: {reasons}" if reasons else ""),
        allowed=", ".join(list(stream.names)[:MOST_NAMES]),
        next_step=FAR if _commonest(refused) == OUT_OF_RANGE else SWITCH_ON,
    )


def _something_else(stream: LiveStream, where: str) -> tuple[str, str]:
    """What arrives instead of what the address reads, and the next step; "" each where unknown."""
    if where.partition("://")[0] not in KINDS:  # the caller's own source
        return "", ""
    address, got = parse_address(where), recognise(stream.undecoded)
    kind = address.recorded if address.kind == REPLAY else address.kind
    if kind is None or not got.kind or reads(kind, got):
        return "", ""
    return got.text, advice_for(kind, got, port=address.port, recording=str(address.path or ""))


def _nothing(stream: LiveStream, waited: float, *, where: str) -> InputError:
    """The error for a stream on which nothing has arrived, with the address and port that are listened on."""
    what, receiver = f"nothing arrives, waited {waited:g} s", stream.receiver
    if not isinstance(receiver, UdpReceiver):
        step = "Start the sender, let it send to this address and port, and see that no firewall is between"
        return InputError(what, where=where, next_step=step)
    host, port = receiver.bound
    found, step = f"{host}, UDP port {port}", f"Start the sender, and let it send to {host}, port {port}"
    if IPv4Address(host).is_loopback:
        found += ", which only this machine can reach"
        step += f". {for_others(where.partition('://')[0], port)}"
    else:
        step += "; see that no firewall is between"
    step += f". `retarget doctor {shlex.quote(where)}` says what may keep it out"
    return InputError(what, where=where, found=f"listening at {found}", next_step=step)


def refuse_version(stream: LiveStream, now: float) -> None:
    """Raise InputError for a Motive version that cannot be read, though its frames may look readable."""
    if _is_foreign(stream):
        raise InputError.from_problems(_motive(stream, now))


class StreamProblems:
    """Watches a stream in every tick, and reports the reason once in every silence. `now` is s of the clock of the
    run."""

    def __init__(self, stream: LiveStream) -> None:
        self._stream = stream
        self._patience = NATNET_S if isinstance(stream.receiver, NatnetReceiver) else SILENT_S
        self._reported = ""
        self._before: tuple[int, Counter[str]] | None = None
        """Counts when the silence began, or was first seen: datagrams, refusals by reason."""
        self._noted = 0.0  # [s] when that was

    @property
    def foreign(self) -> bool:
        """Whether the sender now has a version that cannot be read, whatever its frames look like."""
        return _is_foreign(self._stream)

    def look(self, now: float) -> str:
        """Return what is wrong; "" where nothing is, or where it was reported before."""
        silence = now - self._stream.last
        if silence < NOTED_S:
            self._before = None
        elif self._before is None:
            self._before, self._noted = self._seen(), now
        if not self.foreign and silence < 0.5 * self._patience:
            self._reported = ""
        if self._reported:
            return ""
        self._reported = _motive(self._stream, now)[0].render() if self.foreign else self.why(now)
        return self._reported

    def briefly(self, now: float, patience: float) -> str:
        """What is wrong at `now`, s, in a few words; "" where a frame came within `patience`, s."""
        if self.foreign:
            return "the sender's version is not known"
        if now - self._stream.last <= patience:
            return ""
        arrived, refused = self._before or self._seen()
        if self._stream.arrived == arrived:
            return "nothing arrived"
        return f"what arrived was unusable: {_listed(_refused(self._stream) - refused) or 'no poses in it'}"

    def why(self, now: float) -> str:
        """Return what is wrong, also where it was reported before; "" for nothing."""
        silence = now - self._stream.last
        # What arrives instead is only known of the time since it was noted.
        if self._before is None or silence < self._patience or now - self._noted < 0.5 * self._patience:
            return ""
        return self._cause(silence, now, *self._before)

    def _seen(self) -> tuple[int, Counter[str]]:
        return self._stream.arrived, _refused(self._stream)

    def _cause(self, silence: float, now: float, arrived: int, refused: Counter[str]) -> str:
        problems, news = _motive(self._stream, now), _refused(self._stream) - refused
        if problems:
            return problems[0].render() + (f" What arrived was not used: {_listed(news)}" if news else "")
        if self._stream.receiver.finished:
            return f"{OVER.format(silence)}. {LONGER}"
        if self._stream.arrived == arrived:
            return f"nothing has arrived for {silence:.1f} s: see that the sender runs, and sends here"
        reasons = _listed(news) or "no poses in it"
        return f"what arrives has been unusable for {silence:.1f} s: {reasons}. {_step(self._stream, news)}"


def _refused(stream: LiveStream) -> Counter[str]:
    """Counts of everything that was not used so far, by reason; a copy."""
    stages = stream.admission.refused, stream.decoder.dropped, stream.receiver.dropped, stream.validity.refused
    counts = (*stages, stream.clock_map.dropped, stream.playout.dropped)
    return sum((dropped.reasons for dropped in counts), Counter[str]())


def _listed(reasons: Counter[str]) -> str:
    return "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common(MOST_REASONS))


def _commonest(reasons: Counter[str]) -> str:
    """The commonest reason, "" for none."""
    return max(reasons, key=reasons.__getitem__, default="")


def _step(stream: LiveStream, reasons: Counter[str]) -> str:
    """The next step for what was not used, by its commonest reason."""
    admission, commonest = stream.admission, _commonest(reasons)
    if commonest == SECOND_SOURCE and admission.owner is not None:
        return OWNER_SILENT.format("{}:{}".format(*admission.owner))
    if commonest == NOT_ALLOWED:
        who = ",".join(address for address, reason in admission.named if reason == NOT_ALLOWED)
        return f"If that is the sender, name it in the address: ?allow={who}"
    return STEPS.get(commonest) or (QUATERNIONS if isinstance(stream.decoder, MvnDecoder) else SENDER)


def _is_foreign(stream: LiveStream) -> bool:
    receiver = stream.receiver
    server = receiver.session.server if isinstance(receiver, NatnetReceiver) else None
    return server is not None and not OLDEST <= server.version <= NEWEST


def _motive(stream: LiveStream, now: float) -> list[Problem]:
    """The problems that Motive's answers show."""
    receiver = stream.receiver
    return [*natnet_problems(receiver.session, now, host=receiver.host)] if isinstance(receiver, NatnetReceiver) else []


# Messages about a stream while it runs, each once: other senders, losses, a clock that jumped.

_JUMPS = {
    JumpKind.RESTARTED: "the sender's clock began anew: it was started again",
    JumpKind.FORWARD: "the sender's clock jumped forward by {:.2f} s",
    JumpKind.BACK: "the sender's clock jumped back by {:.2f} s",
}
_NOT_USED = {
    TOO_LONG: (1, "datagrams that are empty or longer than 64 KiB are not used"),
    TOO_MANY: (5_000, "the sender sends more datagrams than are taken: the rest is not used"),
}
"""Counts from which these are reported: what waited in the kernel while a bus was opened comes at once, and is no
flood."""


class StreamNews:
    """Watches a stream in every tick. Its messages are few, and bounded however much other senders send."""

    def __init__(self, stream: LiveStream, notify: Notify) -> None:
        """notify: receives one sentence for each event."""
        self._stream, self._notify = stream, notify
        self._reported = set[str]()
        self._jumps = stream.clock_map.jumps  # earlier jumps are of a sender that starts
        self._refused = 0
        self._overflowed: int | None = None

    def look(self) -> None:
        """Report what has happened since the last look."""
        admission, clock = self._stream.admission, self._stream.clock_map
        if admission.refused.count != self._refused:
            self._refused = admission.refused.count
            for source, reason in admission.news():
                self._notify(_refusal(source, reason, admission.owner))
            for reason, (count, text) in _NOT_USED.items():
                if admission.refused.reasons[reason] >= count:
                    self._once(text)
        if clock.jumps != self._jumps and clock.last_jump is not None:
            self._jumps = clock.jumps
            jump = clock.last_jump
            self._once(_JUMPS[jump.kind].format(abs(jump.shift)), key=jump.kind)
        overflowed = getattr(self._stream.receiver, "overflowed", 0)  # of sockets
        if self._overflowed is None:  # the stream was not polled while a bus was opened
            self._overflowed = overflowed
        if overflowed > self._overflowed:
            self._once("datagrams were lost in this computer: they came faster than they were fetched")
        tap = self._stream.tap
        if tap is not None and (news := tap.news()):
            self._notify(news)

    def _once(self, text: str, *, key: str = "") -> None:
        if (key or text) not in self._reported:
            self._reported.add(key or text)
            self._notify(text)


def _refusal(source: Source, reason: str, owner: Source | None) -> str:
    who = f"{source[0]}:{source[1]}"
    if reason == NEW_SOCKETS:
        return f"{reason}, and all but the first are ignored. {STEPS[reason]}"
    if reason == SECOND_SOURCE and owner is not None:
        return f"{who} sends too, and is ignored: {owner[0]}:{owner[1]} was first"
    if reason == NOT_ALLOWED:
        return f"{who} sends too, and is ignored: not on the allow-list (?allow=)"
    return f"{who} sends too, and is ignored: {reason}"


# The report after a live run: what came, what was not used, which sensors were lost, how often the robot held.

MS = 1e3
"""Milliseconds in a second."""


@dataclass(frozen=True)
class Holds:
    """How often the performer was no longer followed, and how long in all, s."""

    count: int
    s: float


@dataclass(frozen=True)
class TimePercentiles:
    """Median and 99th percentile of times, ms."""

    p50: float
    p99: float


def spread_of(times: Sequence[float]) -> TimePercentiles:
    """The spread of times, s, of which there is at least one."""
    p50, p99 = np.percentile(np.asarray(times) * MS, (50.0, 99.0)).tolist()
    return TimePercentiles(p50, p99)


LATEST = 25
"""Frames of a second of a camera, over which the latency of now is taken."""
MOST_TIMED = 100_000
"""Frames whose way to the goals is kept: the last quarter of an hour of a headset."""


class GoalLatency:
    """How long frames are under way inside this program: from the arrival of each to the first goals after it, which
    are on the bus. Call `note` when goals were sent."""

    def __init__(self, stream: LiveStream) -> None:
        self._stream, self._last = stream, stream.last
        self.times: deque[float] = deque(maxlen=MOST_TIMED)
        """s, of every frame that was the newest when goals were sent."""

    def recent(self) -> float | None:
        """The median of the newest LATEST frames, s; None before the first."""
        latest = [*islice(reversed(self.times), LATEST)]
        return float(np.median(latest)) if latest else None

    def note(self, now: float) -> None:
        """Goals were sent at `now`, s."""
        if self._stream.last > self._last:
            self._last = self._stream.last
            self.times.append(now - self._last)


@dataclass(frozen=True)
class LiveReport:
    """The report on a live run's stream.

    frames, datagrams: of the sender from the beginning on, calibration included. dropped: what was not used, by reason:
    datagrams, frames out of time, and invalid poses. refused: senders that were ignored. lost_s: how long each sensor
    was invalid while the robot followed or held, for sensors that ever were. playout_delay_ms: at the end. smoothing:
    of the sensors, see `SMOOTHINGS`. latency_ms: by stage: "goal" from the arrival of a frame to the first goals on the
    bus after it; of `web://` also "page" from the capture of a picture to its sending, and "network" half of there and
    back. person: the name under which the performer's size is kept, null without one.
    """

    address: str
    frames: int
    datagrams: int
    dropped: dict[str, int]
    refused: tuple[str, ...]
    lost_s: dict[str, float]
    holds: Holds
    playout_delay_ms: float
    smoothing: str
    latency_ms: dict[str, TimePercentiles]
    person: str | None


class Tally:
    """Counts ticks of invalid sensors and of holds. names: of the k sensors; dt: s between ticks."""

    def __init__(self, names: tuple[str, ...], dt: float) -> None:
        self._names, self._dt = names, dt
        self._lost = np.zeros(len(names), dtype=int)
        self._holds = self._held = 0
        self._followed = False  # in the tick before
        self._ever = False

    def count(self, states: StateArray, *, followed: bool) -> None:
        """Count one tick. states (k,): a `ValidityState` each; followed: whether the performer was followed."""
        if np.count_nonzero(states):  # FRESH is 0
            self._lost += (states != ValidityState.FRESH) & (states != ValidityState.NOT_IN_USE)
        self._holds += self._followed and not followed
        self._followed, self._ever = followed, self._ever or followed
        self._held += self._ever and not followed

    @property
    def holds(self) -> Holds:
        """The holds so far."""
        return Holds(self._holds, self._held * self._dt)

    @property
    def lost_s(self) -> dict[str, float]:
        """Time, s, that each sensor was lost so far, for sensors that ever were."""
        return {name: ticks * self._dt for name, ticks in zip(self._names, self._lost.tolist(), strict=True) if ticks}


def live_report(
    stream: LiveStream, tally: Tally, times: Mapping[str, Sequence[float]], *, address: str, person: str | None
) -> LiveReport:
    """The report on a run that has ended. times: of each stage, s."""
    return LiveReport(
        address=address,
        frames=stream.frames,
        datagrams=stream.arrived,
        dropped=dict(_refused(stream).most_common()),
        refused=tuple(f"{source}: {reason}" for source, reason in stream.admission.named),
        lost_s=tally.lost_s,
        holds=tally.holds,
        playout_delay_ms=MS * stream.playout.delay,
        smoothing=stream.smoothing,
        latency_ms={stage: spread_of(taken) for stage, taken in times.items() if taken},
        person=person,
    )
