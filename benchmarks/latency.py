"""`python -m benchmarks.latency`: how long a motion of a hand takes to the shafts of OP3, by stage.

A sender of five sensors as JSON, 90 Hz with jitter and noise; the whole live path; all bytes of the bus. On emulated
servos, and on emulated servos that move a robot with mass. There also hands that stay in reach and within the speeds
that a robot with mass is planned for: the others crouch and reach, and are faster than that. Time is virtual: what the
machine computes takes its CPU time. `measured apart` compares what the sender sent, by its own clock, with the shafts,
and knows of no stage.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.table import add_docs, show_table
from benchmarks.tick_cost import five
from hardware.clock import VirtualClock
from retarget.cli.buses import PhysicsBench
from retarget.frames import SensorFrames
from retarget.human.samples import Performance
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.model.robot import RobotBody
from retarget.report import latency
from retarget.report.latency import LATENCY_STAGES, Latency, latency_of
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare_for
from retarget.run.run_result import RunResult
from retarget.schema.performer import Performer
from sim.faults.sender import STILL_S, FakeSender
from sim.performer import gesturing_performer, synthetic_performer

RATE_HZ = 90.0
"""Rate of the sender: that of the headsets, Hz."""
RUNS = {
    "emulator": ("emulator", synthetic_performer),
    "physics+wire": ("physics+wire", synthetic_performer),
    "the same, in reach": ("physics+wire", gesturing_performer),
}
"""Bus and performer of each column."""


@dataclass(frozen=True, eq=False)
class Measured:
    """The latency of a run as its report has it, and the way from hand to shaft by the sender's own clock, s."""

    report: Latency
    apart: Floats


def measure(bus: str, performed: SensorFrames, seconds: float) -> Measured:
    """A live run on a bus, so many s of following. Raises RuntimeError where no hand has moved for long enough."""
    sender, clock = FakeSender(five(performed), rate_hz=RATE_HZ), VirtualClock()
    bench = PhysicsBench(RunOptions(robot="op3", bus=bus), lambda text: None)
    begun = list[float]()

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        assert robot is not None
        stream = open_stream(None, performer, receiver=sender)
        begun.append(clock.now())
        options = LiveOptions(countdown=0.3, duration=seconds)
        rate = robot.profile.safety.rate_hz
        return begin_live(stream, options, clock=clock, rate_hz=rate, where="json://", notify=lambda text: None)

    options = RunOptions(robot="op3", bus=bus)
    with prepare_for(perform, options, clock=clock, make_bus=bench.make_bus, goes_to_rest=True) as prepared:
        run = prepared.run()
        run = replace(run, live=prepared.samples.report(address="json://", person=None))  # type: ignore[attr-defined]
    found = latency_of(run)
    if found is None or found.hand_to_shaft is None:
        raise RuntimeError("no hand has moved for long enough")
    return Measured(found, apart(run, sender, begun[0]))


def apart(run: RunResult, sender: FakeSender, begun: float) -> Floats:
    """Ways from hand to shaft, s, by what the sender sent at the times of the ticks."""
    times = run.record.time_used[run.record.following]
    rows = np.clip(np.rint((times - begun - STILL_S) * sender.rate_hz), 0, len(sender.track) - 1).astype(int)
    sent = {name: sender.track[rows, column] for column, name in enumerate(sender.frames.names)}
    return np.array(latency.lags(run, sent))


def main() -> None:
    """Measure on both buses, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of following")
    add_docs(parser)
    wanted = parser.parse_args()
    found = {name: measure(bus, performer(), wanted.seconds) for name, (bus, performer) in RUNS.items()}
    rows = []
    for stage in LATENCY_STAGES:
        spreads = [one.report.stages.get(stage) for one in found.values()]
        rows.append([stage, *("" if one is None else f"{one.p50:.1f} ({one.p99:.1f})" for one in spreads)])
    for name, whole in (
        ("stages together", [one.report.together for one in found.values()]),
        ("hand to shaft", [one.report.hand_to_shaft for one in found.values()]),
    ):
        rows.append([name, *("" if one is None else f"{one.p50:.1f} ({one.p99:.1f})" for one in whole)])
    apart = [1e3 * np.percentile(one.apart, (50, 99)) for one in found.values()]
    rows.append(["measured apart", *(f"{median:.1f} ({p99:.1f})" for median, p99 in apart)])
    show_table("latency", ["ms, median (p99)", *RUNS], rows, docs=wanted.docs)


if __name__ == "__main__":
    main()
