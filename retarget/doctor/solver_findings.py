"""Python and the compiled solver: are they there, and what does a frame cost on this machine."""

import importlib
import platform
import sys
from collections.abc import Callable

import numpy as np

import retarget
from hardware.clock import thread_cpu
from retarget.doctor.finding import Finding, mend, note, ok

__all__ = ["frame_findings", "python_findings", "seconds_per_frame"]

OLDEST = (3, 11)
FRAMES = 100
SLOW_S, TOO_SLOW_S = 0.003, 0.008
"""CPU time of both stages for a frame: from where on it is tight, and too much, of the 10 ms of a tick."""
AMPLITUDE_M = 0.05


def python_findings(version: tuple[int, ...] = sys.version_info[:3]) -> list[Finding]:
    """Version of Python, and whether the compiled core can be imported."""
    told = f"{'.'.join(map(str, version))} ({platform.python_implementation()}, {platform.machine()})"
    found = []
    if version < OLDEST:
        found.append(mend("Python", told, "Install Python 3.11 or newer, and retarget into it"))
    else:
        found.append(ok("Python", told))
    try:
        importlib.import_module("retarget._solver")
    except ImportError as error:
        step = "Install the wheel for this machine, or build it: make install (needs cargo)"
        return [*found, mend("wheel", f"the compiled solver cannot be imported ({error})", step)]
    return [*found, ok("wheel", f"retarget {retarget.__version__}, compiled solver there")]


def frame_findings(measure: "Callable[[], float] | None" = None) -> list[Finding]:
    """What a frame costs. measure: returns s; None: `seconds_per_frame`."""
    try:
        cost = (measure or seconds_per_frame)()
    except ImportError:
        return []
    told = f"{1e3 * cost:.2f} ms of CPU per frame, performer to OP3"
    if cost > TOO_SLOW_S:
        return [
            mend("solver", f"{told}, of a tick of 10 ms", "Use a faster computer, or a lower rate_hz in the profile")
        ]
    if cost > SLOW_S:
        return [note("solver", told, "Little room is left in a tick of 10 ms: end what else runs")]
    return [ok("solver", told)]


def seconds_per_frame(frames: int = FRAMES) -> float:
    """Median CPU time, s, of both stages for a performer who waves while OP3 follows. Takes about a second."""
    from retarget.follow import Follower
    from retarget.frames import SensorSample
    from retarget.human import build_human
    from retarget.human_dimensions import proportional_dimensions
    from retarget.performer import load_performer
    from retarget.priorities import load_priorities
    from retarget.reconstruct import Reconstructor
    from retarget.robot_body import load_robot

    size = proportional_dimensions(1.75)
    human, performer = build_human(size), load_performer("five")
    names = tuple(performer.sensors)
    kinematics, q = human.body.solver_body(), human.posture("attractor")
    joints = [human.body.frame(name) for name in names]
    rest = kinematics.points(q[None], [one.body for one in joints], np.array([one.position for one in joints]))[0]
    wrists = [names.index("l_wrist"), names.index("r_wrist")]
    blank, valid = np.full((len(names), 4), np.nan), np.ones(len(names), dtype=bool)

    def sample(tick: int) -> SensorSample:
        place = np.array(rest)
        place[wrists, 2] += AMPLITUDE_M * np.sin(0.05 * tick)
        return SensorSample(names, place, blank, valid)

    reconstructor = Reconstructor(human, load_priorities("human"), performer)
    robot = load_robot("op3")
    follower = Follower(robot, load_priorities(robot.profile.retarget), size)
    follower.start(reconstructor.start(sample(0)))
    costs = []
    for tick in range(1, frames + 1):
        before = thread_cpu()
        follower.step(reconstructor.step(sample(tick), 0.01), 0.01)
        costs.append(thread_cpu() - before)
    return float(np.median(costs))
