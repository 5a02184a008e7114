"""Reports on a stream: why it cannot be used, messages while it runs, and the report after the run."""

import shlex
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address
from itertools import islice
from typing import Any

import numpy as np

from retarget.errors import InputError, Problem
from retarget.human.pose_validation import StateArray, ValidityState
from retarget.live.address import KINDS, for_others, parse_address
from retarget.live.admission import NOT_ALLOWED, TOO_LONG, TOO_MANY
from retarget.live.advice import advice, problem, refusal
from retarget.live.receivers import NatnetReceiver, UdpReceiver
from retarget.live.sensor_validity import OUT_OF_RANGE
from retarget.live.stream import LiveStream
from retarget.sources.streams.datagram_kinds import Recognised, reads, recognise
from retarget.sources.streams.natnet_session import NEWEST, NatnetSession
from retarget.sources.streams.natnet_wire import COMMAND_PORT, DATA_PORT, OLDEST
from retarget.sources.streams.stream_frame import CONVENTIONS
from retarget.types import News, Notify


def advice_for(kind: str, got: Recognised, *, port: int, recording: str = "") -> str:
    """The remedy for datagrams `got` at an address of `kind`; "" if the address reads them. recording: their file."""
    symptom = f"instead {got.kind}" if got.kind else f"undecoded {got.name}"
    if reads(kind, got):
        symptom = f"part {got.detail}"
    elif got.kind and recording:
        symptom = f"recorded {got.kind}"
    usual = KINDS[got.kind].port if got.kind else None
    facts = {"port": port, "recording": recording, "got": got.kind, "name": got.name, "usual": usual}
    return advice(symptom, kind, sender=KINDS[kind].sender, axes=", ".join(CONVENTIONS), **facts).then


ANSWER_TIMEOUT_S = 3.0  # [s] after which an answer counts as missing


def natnet_problems(session: NatnetSession, now: float, *, host: str) -> tuple[Problem, ...]:
    """List the problems at `now`, s, causes before consequences. host: as the user gave it."""
    server, found = session.server, list[Problem]()

    def note(symptom: str, *, seen: str = "", **facts: Any) -> None:
        found.append(problem(symptom, host, "natnet", found=seen, host=host, command_port=COMMAND_PORT, **facts))

    if server is None:
        if session.started is not None and now - session.started >= ANSWER_TIMEOUT_S:
            note("frames without answer" if session.frames else "no answer")
        return tuple(found)
    if not OLDEST <= server.version <= NEWEST:
        seen = f"{server.version}, from {server.name} {server.app_version[0]}.{server.app_version[1]}"
        symptom = "old version" if server.version < OLDEST else "new version"
        note(symptom, seen=seen)
        return tuple(found)
    if session.silent(now):
        sent_to = server.group, server.data_port or DATA_PORT
        if server.multicast != (session.group is not None):
            sent, requested = ("multicast", "unicast") if server.multicast else ("unicast", "multicast")
            to = f" to {server.group}, port {server.data_port}" if server.multicast else ""
            note("other transport", seen=sent + to, sent=sent, requested=requested)
        elif session.group is None:
            note("no frames")
        elif sent_to != session.group:
            seen, own = ("{}, port {}".format(*place) for place in (sent_to, session.group))
            note("other group", seen=seen, own=own, group=sent_to[0], port=sent_to[1])
        else:
            note("no frames, multicast", group=session.group[0], port=session.group[1])
    if session.definitions_requested_at is not None and now - session.definitions_requested_at >= ANSWER_TIMEOUT_S:
        note("no names")
    return tuple(found)


NOTED_S = 0.05  # [s] without a frame after which counts are noted: later arrivals come instead of frames
SILENT_S = 1.0  # time without a frame after which the reason is reported
NATNET_S = 2.5  # the same where Motive is asked first
MOST_REASONS, MOST_NAMES = 3, 40  # in a message, to keep it readable


def refused_counts(stream: LiveStream) -> Counter[str]:
    """Counts of everything that was not used, by reason; a copy."""
    stages = stream.admission.refused, stream.decoder.dropped, stream.receiver.dropped, stream.validity.refused
    counts = (*stages, stream.clock_map.dropped, stream.playout.dropped)
    return sum((dropped.reasons for dropped in counts), Counter[str]())


def _listed(reasons: Counter[str]) -> str:
    return "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common(MOST_REASONS)) or "no poses in it"


def _commonest(reasons: Counter[str]) -> str:
    return max(reasons, key=reasons.__getitem__, default="")


def _mistake(reasons: Counter[str]) -> str:
    return advice(f"mistake {_commonest(reasons)}").then


def _step(stream: LiveStream, reasons: Counter[str]) -> str:
    admission = stream.admission
    refused = ",".join(address for address, reason in admission.named if reason == NOT_ALLOWED)
    owner = "{}:{}".format(*admission.owner or ("the sender", "any port"))
    return _mistake(reasons) or advice(f"reason {_commonest(reasons)}", stream.kind, owner=owner, refused=refused).then


def _motive(stream: LiveStream, now: float) -> list[Problem]:
    receiver = stream.receiver
    return [*natnet_problems(receiver.session, now, host=receiver.host)] if isinstance(receiver, NatnetReceiver) else []


def _is_foreign(stream: LiveStream) -> bool:
    receiver = stream.receiver
    server = receiver.session.server if isinstance(receiver, NatnetReceiver) else None
    return server is not None and not OLDEST <= server.version <= NEWEST


def refuse_version(stream: LiveStream, now: float) -> None:
    """Raise InputError for a Motive version that cannot be read."""
    if _is_foreign(stream):
        raise InputError.from_problems(_motive(stream, now))


def unusable(stream: LiveStream, missing: list[str], waited: float, *, where: str, now: float) -> InputError:
    """Make the error for a stream that cannot be used. missing: needed sensors that are not fresh."""
    refused, silence = refused_counts(stream), now - stream.last
    if problems := _motive(stream, now):
        return InputError.from_problems(problems)
    if stream.arrived == 0:
        return _nothing(stream, waited, where=where)
    if stream.frames == 0 or _mistake(refused):
        got, step = _instead(stream, where)
        found = got or _listed(refused)
        found = found if stream.frames else f"{stream.arrived} datagrams: {found}"
        return refusal(InputError, "cannot be used", where, found=found, step=step or _step(stream, refused))
    absent = ", ".join(f"no {name}" for name in missing)
    if silence >= 0.5 * SILENT_S:
        found = "" if stream.receiver.finished else f"{stream.frames} frames before that, and now {absent}"
        symptom = "over" if stream.receiver.finished else "silent"
        return refusal(InputError, symptom, where, stream.kind, found=found, silence=silence)
    sent = dict(zip(stream.roles.sensors, stream.roles.places, strict=True))
    absent = ", ".join(f"no {name} ({sent[name].position})" for name in missing)
    found = absent + (f"; refused: {_listed(refused)}" if refused else "")
    symptom = "missing, outside" if _commonest(refused) == OUT_OF_RANGE else "missing"
    names = ", ".join(list(stream.names)[:MOST_NAMES])
    return refusal(InputError, symptom, where, found=found, names=names, step=_step(stream, refused))


def _instead(stream: LiveStream, where: str) -> tuple[str, str]:
    got = recognise(stream.undecoded)
    if stream.frames or where.partition("://")[0] not in KINDS or not got.kind:  # also the caller's own source
        return "", ""
    address = parse_address(where)
    kind = stream.kind or address.kind
    if reads(kind, got):
        return "", ""
    return got.text, advice_for(kind, got, port=address.port, recording=str(address.path or ""))


def _nothing(stream: LiveStream, waited: float, *, where: str) -> InputError:
    receiver = stream.receiver
    if not isinstance(receiver, UdpReceiver):
        return refusal(InputError, "nothing arrives", where, stream.kind, waited=waited)
    host, port = receiver.bound
    here = IPv4Address(host).is_loopback
    facts = {"waited": waited, "host": host, "port": port, "quoted": shlex.quote(where)}
    facts["others"] = for_others(where.partition("://")[0], port)
    found = f"listening at {host}, UDP port {port}" + (", which only this machine can reach" if here else "")
    symptom = f"nothing arrives, {'loopback' if here else 'port'}"
    return refusal(InputError, symptom, where, stream.kind, found=found, **facts)


NOTHING = News("")


def _of_motive(problem: Problem, more: str = "") -> News:
    return News(problem.render() + more, problem.what, is_due=True)


class StreamProblems:
    """Watches a stream in every tick, and reports the reason once in every silence."""

    def __init__(self, stream: LiveStream) -> None:
        self._stream = stream
        self._silence_limit = NATNET_S if isinstance(stream.receiver, NatnetReceiver) else SILENT_S
        self._reported = ""
        self._before: tuple[int, Counter[str]] | None = None  # when the silence began: datagrams, refusals by reason
        self._noted = 0.0  # [s] when that was

    @property
    def foreign(self) -> bool:
        """True if the sender has a version that cannot be read."""
        return _is_foreign(self._stream)

    def look(self, now: float) -> News:
        """The problem, once; "" for none."""
        silence = now - self._stream.last
        if silence < NOTED_S:
            self._before = None
        elif self._before is None:
            self._before, self._noted = self._seen(), now
        if not self.foreign and silence < 0.5 * self._silence_limit:
            self._reported = ""
        if self._reported:
            return NOTHING
        reported = _of_motive(_motive(self._stream, now)[0]) if self.foreign else self.why(now)
        self._reported = reported
        return reported

    def briefly(self, now: float, limit: float) -> str:
        """The problem at `now`, s, in a few words; "" where a frame came within `limit`, s."""
        if self.foreign:
            return "the sender's version is not known"
        if now - self._stream.last <= limit:
            return ""
        arrived, refused = self._before or self._seen()
        symptom = "silent short" if self._stream.arrived == arrived else "unusable short"
        return advice(symptom, self._stream.kind, reasons=_listed(refused_counts(self._stream) - refused)).what

    def why(self, now: float) -> News:
        """The problem, even if it was reported before; "" for none."""
        stream, silence = self._stream, now - self._stream.last
        # Arrivals instead of frames are known only since the counts were noted.
        if self._before is None or silence < self._silence_limit or now - self._noted < 0.5 * self._silence_limit:
            return NOTHING
        arrived, refused = self._before
        news = refused_counts(stream) - refused
        if problems := _motive(stream, now):
            return _of_motive(problems[0], f" What arrived was not used: {_listed(news)}" if news else "")
        if stream.receiver.finished or stream.arrived == arrived:
            symptom = "over" if stream.receiver.finished else "silent"
            return News(advice(symptom, stream.kind, silence=silence).text, symptom, is_due=True)
        row = advice("unusable", stream.kind, silence=silence, reasons=_listed(news))
        return News(f"{row.what}. {_step(stream, news)}", "unusable", is_due=True)

    def _seen(self) -> tuple[int, Counter[str]]:
        return self._stream.arrived, refused_counts(self._stream)


# Datagrams that waited while a bus was opened are no flood.
REPORTED_FROM = {TOO_LONG: ("too long", 1), TOO_MANY: ("too many", 5_000)}


class StreamNews:
    """Watches a stream in every tick. Its messages are few, however much other senders send."""

    def __init__(self, stream: LiveStream, notify: Notify) -> None:
        self._stream, self._notify = stream, notify
        self._reported = set[str]()
        self._jumps = stream.clock_map.jumps  # earlier jumps are of a sender that starts
        self._refused = 0
        self._overflowed: int | None = None

    def look(self) -> None:
        """Report all events since the last look."""
        admission, clock = self._stream.admission, self._stream.clock_map
        if admission.refused.count != self._refused:
            self._refused = admission.refused.count
            owner = "{}:{}".format(*admission.owner or ("another", "any port"))
            for source, reason in admission.news():
                sender = f"{source[0]}:{source[1]}"
                text = advice(f"refused {reason}", sender=sender, reason=reason, owner=owner).what
                self._notify(News(text, reason))
            for reason, (symptom, count) in REPORTED_FROM.items():
                if admission.refused.reasons[reason] >= count:
                    self._once(symptom)
        if clock.jumps != self._jumps and clock.last_jump is not None:
            self._jumps = clock.jumps
            self._once(f"clock {clock.last_jump.kind}", shift=abs(clock.last_jump.shift))
        overflowed = getattr(self._stream.receiver, "overflowed", 0)  # of sockets
        if self._overflowed is None:  # the stream was not polled while a bus was opened
            self._overflowed = overflowed
        if overflowed > self._overflowed:
            self._once("overflowed")
        tap = self._stream.tap
        if tap is not None and (news := tap.news()):
            self._notify(news)

    def _once(self, symptom: str, **facts: float) -> None:
        if symptom not in self._reported:
            self._reported.add(symptom)
            if text := advice(symptom, self._stream.kind, **facts).what:
                self._notify(News(text, symptom))


MS = 1e3  # milliseconds in a second


@dataclass(frozen=True)
class Holds:
    """Number of holds in which the performer was not followed, and their time in all, s."""

    count: int
    s: float


@dataclass(frozen=True)
class TimePercentiles:
    """Median and 99th percentile of times, ms."""

    p50: float
    p99: float


def spread_of(times: Sequence[float]) -> TimePercentiles:
    """Percentiles of at least one time, s."""
    p50, p99 = np.percentile(np.asarray(times) * MS, (50.0, 99.0)).tolist()
    return TimePercentiles(p50, p99)


LATEST = 25  # frames of a second of a camera, over which the present latency is taken
MOST_TIMED = 100_000  # frames: the last quarter of an hour of a headset


class GoalLatency:
    """Measures the time from the arrival of each frame to the first goals after it."""

    def __init__(self, stream: LiveStream) -> None:
        self._stream, self._last = stream, stream.last
        # Times, s, of every frame that was the newest when goals were sent.
        self.times: deque[float] = deque(maxlen=MOST_TIMED)

    def recent(self) -> float | None:
        """The median of the newest LATEST frames, s; None before the first."""
        latest = [*islice(reversed(self.times), LATEST)]
        return float(np.median(latest)) if latest else None

    def note(self, now: float) -> None:
        """Note that goals were sent at `now`, s."""
        if self._stream.last > self._last:
            self._last = self._stream.last
            self.times.append(now - self._last)


@dataclass(frozen=True)
class LiveReport:
    """The report on a live run's stream.

    frames, datagrams: from the beginning on, calibration included. dropped: counts of unused data by reason. refused:
    senders that were ignored. lost_s: time that each sensor was invalid while the robot followed or held. latency_ms:
    by stage: "goal" from the arrival of a frame to the first goals after it; of `web://` also "page" from the capture
    of a picture to its sending, and "network" half of a round trip.
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
        """Count one tick. states (k,): a `ValidityState` each."""
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
