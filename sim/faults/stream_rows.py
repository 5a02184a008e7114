"""Rows of the fault table: what goes wrong with a sender and its datagrams."""

import re
from collections.abc import Callable

import numpy as np

from retarget.live.datagram import Datagram
from sim.faults.bench import Bench
from sim.faults.reaction import EVER, Idle, Reaction, Row
from sim.faults.sender import SenderFault, encoded, flapping, frozen, lost, moved, pausing, silent, swapped

__all__ = ["STREAM_ROWS", "later"]

FLOOD_HZ = 130_000.0
_NO_NUMBER = "NaN or Infinity: leave the pose out, or say tracked: false"
_NO_POSE = "pose that is no number or no rotation"
_FIRST_NUMBER = re.compile(rb'"p": \[[^,]+,')


def later(act: Callable[[Bench], object]) -> Callable[[Bench, float], object]:
    """A fault that is done when it is due."""
    return lambda bench, at: bench.at(at, lambda: act(bench))


def _sender(make: Callable[[], SenderFault]) -> Callable[[Bench, float], object]:
    return later(lambda bench: bench.sender.faults.append(make()))


def _number(text: bytes) -> Callable[[Bench, float], object]:
    """A number of every place is something else."""

    def garble(time: float, datagram: bytes) -> list[bytes]:
        return [_FIRST_NUMBER.sub(b'"p": [' + text + b",", datagram)]

    return later(lambda bench: bench.sender.garbles.append(garble))


def _no_rotation(bench: Bench) -> None:
    def garble(time: float, datagram: bytes) -> list[bytes]:
        turned = datagram.replace(b"]}", b'], "q": [0.0, 0.0, 0.0, 0.0]}')
        return [turned.replace(b'"axes"', b'"quaternion": "wxyz", "axes"')]

    bench.sender.garbles.append(garble)


def _garbage(time: float, datagram: bytes) -> list[bytes]:
    return [datagram[: len(datagram) // 2], b"", b"\x00\xff" * 20, datagram, b'{"poses": [[[[']


def _leaping(by: float) -> Callable[[Bench, float], object]:
    def leap(bench: Bench) -> None:
        before = bench.sender.stamp
        bench.sender.stamp = lambda time: before(time) + by

    return later(leap)


def _reordered(bench: Bench) -> None:
    kept: list[bytes] = []

    def garble(time: float, datagram: bytes) -> list[bytes]:
        kept.append(datagram)
        del kept[:-3]
        return [kept[-1], kept[-2], kept[-1]] if len(kept) % 3 == 0 else []

    bench.sender.garbles.append(garble)


def _stranger(address: str) -> Callable[[Bench, float], object]:
    """Somebody else sends whole poses."""

    def begin(bench: Bench) -> None:
        def other(first: float, last: float) -> list[Datagram]:
            stamp = bench.sender.stamp(last)  # only who sends it tells that it is another one's
            payload = encoded(stamp, {name: np.array([5.0, 5.0, 1.0]) for name in bench.sender.frames.names})
            return [Datagram(bench.clock.now(), (address, 50_000), payload)]

        bench.sender.others.append(other)

    return later(begin)


def _flood(bench: Bench) -> None:
    def other(first: float, last: float) -> list[Datagram]:
        begun = bench.sender.begun
        times = np.linspace(first, last, round(FLOOD_HZ * (last - first)), endpoint=False)
        return [Datagram(begun + float(time), ("127.0.0.1", 50_001), b"x" * 64) for time in times]

    bench.sender.others.append(other)


STREAM_ROWS: tuple[Row, ...] = (
    Row("stream silent", Reaction.HOLD, 0.150, _sender(lambda: silent(0.0, EVER))),
    Row("stream silent for ever", Reaction.STOP, 5.0, _sender(lambda: silent(0.0, EVER)), after=5.3),
    Row("stream silent for a while", Reaction.RESUME, 1.3, _sender(lambda: pausing(0.4)), back=0.4, after=1.6),
    Row("flapping stream", Reaction.HOLD, 0.150, _sender(flapping), back=EVER, after=1.6),
    Row("not a number", Reaction.HOLD, 0.150, _number(b"NaN"), counted=_NO_NUMBER),
    Row("infinite number", Reaction.HOLD, 0.150, _number(b"1e999"), counted=_NO_POSE),
    Row("quaternion of zeros", Reaction.HOLD, 0.150, later(_no_rotation), counted=_NO_POSE),
    Row(
        "teleport of a wrist",
        Reaction.HOLD,
        0.150,
        _sender(lambda: moved("r_wrist", 0.0, EVER, (0.0, 0.0, 0.8))),
        said="r_wrist",
        counted="position that no human can have reached",
    ),
    Row(
        "wrist frozen",
        Reaction.OUT,
        0.300,
        _sender(lambda: frozen("l_wrist", 0.0, EVER)),
        sensor="l_wrist",
        said="l_wrist",
    ),
    Row("wrist lost", Reaction.OUT, 0.300, _sender(lambda: lost("l_wrist", 0.0, EVER)), sensor="l_wrist"),
    Row("ankle lost", Reaction.HOLD, 0.300, _sender(lambda: lost("l_ankle", 0.0, EVER))),
    Row("pelvis lost", Reaction.HOLD, 0.300, _sender(lambda: lost("pelvis", 0.0, EVER)), performer="six"),
    Row(
        "left and right swapped",
        Reaction.HOLD,
        0.100,
        _sender(lambda: swapped("l_wrist", "r_wrist", 0.0, EVER)),
        said="changed places",
    ),
    Row("late, reordered, twice", Reaction.NONE, 0.0, later(_reordered), counted="repeated"),
    Row("sender's clock leaps on", Reaction.REBASE, 1.0, _leaping(3600.0), after=1.4),
    Row("sender's clock leaps back", Reaction.REBASE, 1.0, _leaping(-3600.0), after=1.4),
    Row(
        "malformed and truncated",
        Reaction.NONE,
        0.0,
        later(lambda bench: bench.sender.garbles.append(_garbage)),
        counted="not JSON in UTF-8",
    ),
    Row(
        "unlisted source",
        Reaction.NONE,
        0.0,
        _stranger("10.9.8.7"),
        said="not on the allow-list",
        counted="sender not on the allow-list",
    ),
    Row(
        "second source",
        Reaction.NONE,
        0.0,
        _stranger("127.0.0.1"),
        said="127.0.0.1:50000 sends too",
        counted="a second source",
    ),
    Row("flood", Reaction.MAY_HOLD, 0.0, later(_flood), idle=Idle.ANY, counted="a second source"),
)
