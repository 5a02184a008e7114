"""Makes the recordings in `fixtures`: `PYTHONPATH=.:tests/support python tests/recording/make_fixtures.py FOLDER`.

It was run once, by the commit that added it. Later code records other runs, so it does not make the same files again:
the ones in `fixtures` are never replaced, and a new format or robot gets files of its own.
"""

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from command_line import code_of
from faulty_bus import FaultKind, MockFault
from hardware.clock import Clock, MonotonicClock, VirtualClock
from hardware.guard_state import StopCause
from live_rig import LiveRig
from recordings import mock_bus, performer, record
from retarget.frames import SensorFrames
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.recording import recorder
from retarget.recording.session import Session, session_of
from retarget.run.loop import Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from sim.faults.sender import FakeSender, SenderFault, lost, silent
from sim.performer import synthetic_performer

EMULATED_FAULTS = """faults:
  - {fault: drop, rate: 0.02, ids: [1], to_cycle: 150}
  - {fault: missing, ids: [19], from_cycle: 200, to_cycle: 206}
  - {fault: missing, ids: [19], from_cycle: 300, to_cycle: 480}
  - {fault: over_temperature, ids: [1], from_cycle: 500}
"""
"""Answers are lost; one servo is silent for a moment, then long enough to stop the run; another is too hot on the way
to rest."""


def nameless_session(*args: Any, **words: Any) -> Session:
    """The session without what belongs to this computer: its processor, and the folder of the config files."""
    session = session_of(*args, **words)
    files = tuple(file.model_copy(update={"path": f"/of_then/{file.name}"}) for file in session.files)
    return session.model_copy(update={"machine": "x86_64", "files": files})


def command(*words: str) -> Callable[[Path], object]:
    """Record as `retarget run` does, from the sample."""
    return lambda path: code_of("run", "--source", "sample", "--record", path, *words)


def emulated(path: Path) -> None:
    faults = path.with_suffix(".yaml")
    faults.write_text(EMULATED_FAULTS, encoding="utf-8")
    command("--robot", "op3", "--bus", "emulator", "--end", "1.5", "--faults", str(faults))(path)
    faults.unlink()


def live(
    path: Path, *, faults: tuple[SenderFault, ...] = (), pauses: tuple[range, ...] = (), seconds: float, forced: bool
) -> None:
    """Record a live run that the operator pauses in some ticks, counted from the first. forced: the operator switches
    torque off as soon as the robot stops; else it goes to rest."""
    rig = LiveRig(FakeSender(faults=[*faults]), options=LiveOptions(countdown=0.5, duration=seconds))
    noted, tick = recorder.Recorder(path, rig.run_options, clock=rig.clock, notify=rig.said.append), 0
    with rig.prepared(noted) as prepared, noted.recording(prepared, source="json://") as recorded:

        def stop_asked() -> bool:
            nonlocal tick
            assert isinstance(prepared.samples, LivePerformer)
            prepared.samples.clutch(engaged=not any(tick in pause for pause in pauses))
            tick += 1
            return False

        recorded.run(noted.watch(Watch(stop_asked=stop_asked, torque_off_asked=lambda: forced), prepared))


def stop_and_torque_off(prepared: Prepared) -> Watch:
    asked, forced = iter(range(10_000)), iter(range(10_000))
    return Watch(stop_asked=lambda: next(asked) == 440, torque_off_asked=lambda: next(forced) == 100)


def stop_from_outside(prepared: Prepared) -> Watch:
    assert prepared.machine is not None
    guard, asked = prepared.machine.guard, iter(range(10_000))

    def stop_asked() -> bool:
        if next(asked) == 180:
            guard.latch(StopCause.FALLEN, "the robot has fallen: over a wire")
        return False

    return Watch(stop_asked=stop_asked)


def run_of(
    path: Path, frames: SensorFrames, options: RunOptions, *, clock: Clock, watch: Watch, ends_well: bool
) -> None:
    """Record a run on the mock bus. ends_well: it ends at rest or standing; else where the robot has braked."""
    noted = recorder.Recorder(path, options, clock=clock, notify=lambda text: None)
    make_bus = noted.make_bus(mock_bus)
    with (
        prepare(lambda: frames, options, clock=noted.clock, make_bus=make_bus, goes_to_rest=ends_well) as prepared,
        noted.recording(prepared, source="synthetic") as recorded,
    ):
        recorded.run(noted.watch(watch, prepared))


def one_step(path: Path) -> None:
    """Record a robot that steps in place, of a performer who stands and lifts the left foot once."""
    frames = performer(2.0)()
    position = np.broadcast_to(frames.position[0], frames.position.shape).copy()
    position[:, frames.index("l_ankle"), 2] += 0.3 * np.sin(0.5 * np.pi * frames.time) ** 2
    orientation = np.broadcast_to(frames.orientation[0], frames.orientation.shape)
    stands = replace(frames, position=position, orientation=orientation, joints=None)
    run_of(path, stands, RunOptions(robot="op3", steps="shift"), clock=VirtualClock(), watch=Watch(), ends_well=False)


def upper_at_wall(path: Path) -> None:
    """Record a robot whose arms keep off a wall, and which ends standing, for it has no way to rest."""
    options = RunOptions(robot="toddlerbot", parts="upper", scene="wall")
    frames = synthetic_performer().cut(1.0, 2.2)
    run_of(path, frames, options, clock=VirtualClock(), watch=Watch(), ends_well=True)


def killed(path: Path) -> None:
    """Record in real time in a process that kills itself while the robot follows."""
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        return
    watch = Watch(lambda done: os.kill(os.getpid(), signal.SIGKILL) if done > 100 else None, every=25)
    run_of(path, performer(5.0)(), RunOptions(robot="op3"), clock=MonotonicClock(), watch=watch, ends_well=False)


def fault(kind: FaultKind, first: int) -> Callable[[Path], object]:
    """Record a run of the mock bus with one fault that stays, and a way to rest."""
    return partial(record, seconds=2.0, faults=(MockFault(kind, first, 100_000),), goes_to_rest=True)


MADE: dict[str, Callable[[Path], object]] = {
    "op3_to_rest": command("--robot", "op3", "--end", "0.4"),
    "human_alone": command("--robot", "human", "--bus", "none", "--end", "1.5"),
    "poppy_physics": command("--robot", "poppy", "--bus", "physics", "--end", "1"),
    "toddlerbot_upper_at_wall": upper_at_wall,
    "one_step": one_step,
    "emulator_lost_and_hot": emulated,
    "live_hold": partial(live, faults=(silent(5.8, 6.1), lost("l_wrist", 6.55, 6.85)), seconds=2.7, forced=True),
    "live_paused": partial(live, pauses=(range(40, 70), range(625, 1240)), seconds=6.5, forced=False),
    "stop_then_torque_off": partial(record, seconds=2.0, watch=stop_and_torque_off, goes_to_rest=True),
    "stop_from_outside": partial(record, seconds=2.0, watch=stop_from_outside, goes_to_rest=True),
    "bus_read_fails": fault(FaultKind.READ_FAILS, 440),
    "bus_write_fails": fault(FaultKind.WRITE_FAILS, 170),
    "killed": killed,
}

if __name__ == "__main__":
    recorder.session_of = nameless_session  # type: ignore[attr-defined]
    for name, make in MADE.items():
        if len(sys.argv) < 3 or name in sys.argv[2:]:
            make(Path(sys.argv[1]) / f"{name}.mcap")
