"""What has to be true of every run, whatever was done to it."""

from hardware.guard_state import GuardState, StopCause
from sim.faults.bench import Bench
from sim.faults.trace import Trace
from sim.faults.wire_checker import Track, after_latch, beyond_limits, hasty, once, restless, tracks, wavering, woken
from sim.faults.wire_clearance import collisions
from sim.faults.wire_packets import Written, goal_writes, torque_off, written

REST_S = 0.35
"""From the beginning of a hold until goals stand still; of a stop, until they are no faster than on the way home."""
OFF_S = 3.0
"""From the beginning of a stop until torque is off."""
HOME_SHARE = 0.45
"""Of the greatest speeds: the longest way home of a joint, 2.4 rad, takes as much to be gone in 2.5 s."""
AGAIN_SHARE, AGAIN_S = 0.25, 0.75
"""Of the greatest speeds, for so long after somebody is followed (again)."""
HELD_S = 0.3
"""A hold that is shorter is none after which the way back has to be slow: it is one of single ticks."""
SETTLED = (GuardState.STOPPING, GuardState.STOPPED)
UNHURT = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Stops of a robot with which nothing is wrong: it is parked before its torque goes."""
PARKED_RAD = 0.01
"""Goals this near to the rest posture are there, rad."""


def violations(bench: Bench, trace: Trace) -> list[str]:
    """Everything that may never be, a line each."""
    if not hasattr(bench, "robot"):
        return []
    robot, writes = bench.robot, written(trace.sent)
    dt = 1.0 / robot.profile.safety.rate_hz
    ways = tracks(once(goal_writes(writes), within=0.5 * dt), robot.joint_map.servos)
    wrong = beyond_limits(ways, dt) + collisions(robot, ways)
    for first, last in trace.holds:
        wrong += [f"in a hold {text}" for text in restless(ways, first + REST_S, last - dt)]
    wrong += _haste(bench, trace, ways, dt) + _stop(bench, trace, ways, writes, dt)
    if trace.gone is None and not (trace.error or trace.stop) and trace.began is None and not trace.ticks:
        wrong.append("nothing was done, and nobody was told why")
    if trace.endless:
        wrong.append("the run did not end")
    return wrong + _torque(bench, trace)


def _haste(bench: Bench, trace: Trace, ways: list[Track], dt: float) -> list[str]:
    """Who hurries on the way to where following begins, or when somebody is followed again."""
    if trace.armed is None:
        return []
    over = trace.ended if trace.latched is None else trace.latched
    arrived = over if trace.arrived is None else trace.arrived
    share = bench.robot.profile.safety.speed_caps.approach
    wrong = [
        f"on its approach {text}" for text in hasty(ways, trace.armed - dt, min(arrived, over), share=share, dt=dt)
    ]
    for first, last in trace.holds:
        if last - first > HELD_S:
            again = hasty(ways, last, min(last + AGAIN_S, over), share=AGAIN_SHARE, dt=dt)
            wrong += [f"after a hold {text}" for text in again]
    return wrong[:8]


def _stop(bench: Bench, trace: Trace, ways: list[Track], writes: list[Written], dt: float) -> list[str]:
    """A stop goes on to its end, and nothing else."""
    begun = trace.latched
    if begun is None:
        return []
    since = trace.ticks[next(row for row, tick in enumerate(trace.ticks) if tick.latched) :]  # two may end at one time
    wrong = [f"{tick.state.value} after a stop" for tick in since if tick.state not in SETTLED]
    before = max((tick.time for tick in trace.ticks if tick.time < begun), default=begun)
    wrong += woken(writes, before)
    off = torque_off(writes, before)
    if off is None:
        if trace.gone is None and not trace.mute:
            wrong.append("torque was never told to go off")
    elif off - begun > OFF_S:
        wrong.append(f"torque went off {off - begun:.2f} s after the stop began, allowed {OFF_S:g} s")
    ended = trace.first(GuardState.STOPPED, begun)
    if ended is not None:
        wrong += after_latch(writes, ended)
    wrong += hasty(ways, begun + REST_S, trace.ended, share=HOME_SHARE, dt=dt)
    if ended is not None and trace.stop is not None and trace.stop.cause in UNHURT and trace.stop.then is None:
        wrong += _astray(bench, ways)
    return wrong[:8] + wavering(ways, begun + REST_S, trace.ended)


def _astray(bench: Bench, ways: list[Track]) -> list[str]:
    """Who was not sent where the robot is parked in the end."""
    robot = bench.robot
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    parked = dict(zip(robot.joint_map.joints, rest.tolist(), strict=True))
    off = {track.servo.label: float(track.angle[-1]) - parked[track.servo.joint] for track in ways}
    return [f"{label} is not parked, {by:.3f} rad off" for label, by in off.items() if abs(by) > PARKED_RAD]


def _torque(bench: Bench, trace: Trace) -> list[str]:
    """In the end nobody has torque, or a person knows; those of a host that is gone stand by their watchdogs."""
    if not any(trace.torque):
        return []
    if trace.gone is not None:
        return [] if all(servo.tripped or not servo.shaft.torque for servo in bench.servos) else ["servos still drive"]
    told = trace.error or (trace.stop is not None and trace.stop.powered)
    return [] if told else ["torque is on in the end, and nobody was told"]
