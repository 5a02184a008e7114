"""The topics of a recording: the message of each, how cycles become messages, and the definitions that ROS 2 knows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.joint_map import JointMap
from retarget.model.robot import RobotBody
from retarget.recording.cdr import CdrLayout, Given, layout_of
from retarget.recording.cycles import READINGS, Cycles, Done, Shape
from retarget.types import FloatArray

SENSORS, JOINTS, GOALS, SERVOS, TICK = "/sensors", "/joint_states", "/goals", "/servos", "/tick"
LANDMARKS, HUMAN_JOINTS, HUMAN_POSTURE, FRAMES = "/landmarks", "/human/joints", "/human/posture", "/tf"
EVENTS, TRUTH = "/events", "/truth"
WORLD = "world"
EVERY_S, SELDOM_S = 0.04, 0.08
"""Times, s, between two messages of what is there to be looked at, and can be computed again from the rest."""
STEP = 2.0**-16
"""Step, m or rad, to which such numbers are rounded: 15 um. Most of their bytes are then zeros."""

Which = Callable[[Cycles], NDArray[np.bool_]]
Values = Callable[[Cycles], dict[str, NDArray[Any]]]


@dataclass(frozen=True, eq=False)
class Topic:
    """name, schema: as in the file. names: of what its arrays hold, for its metadata. which: the cycles that become
    messages, as a mask (T,). values: of cycles (T), the fields of their messages by name, without their stamps."""

    name: str
    schema: str
    names: tuple[str, ...]
    layout: CdrLayout
    which: Which
    values: Values

    def messages(self, cycles: Cycles, stamp_ns: NDArray[np.int64]) -> Iterator[tuple[int, int, bytes]]:
        """Make the messages of cycles that began at `stamp_ns` (T,): number of the cycle, stamp in ns and bytes of each
        message."""
        chosen = np.flatnonzero(self.which(cycles))
        if not chosen.size:
            return
        taken, stamps = cycles if len(chosen) == len(cycles) else cycles.taken(chosen), stamp_ns[chosen]
        rows = self.layout.rows(len(chosen))
        for name in rows.dtype.names or ():
            if name.endswith(".sec"):
                rows[name], rows[f"{name.removesuffix('.sec')}.nanosec"] = np.divmod(stamps, 10**9)
        for name, values in self.values(taken).items():
            if name in (rows.dtype.names or ()):  # what has no columns has no field
                rows[name] = values
        data, size = rows.tobytes(), self.layout.dtype.itemsize
        at = zip(taken.index.tolist(), stamps.tolist(), strict=True)
        for place, (index, stamp) in enumerate(at):
            yield index, stamp, data[place * size : (place + 1) * size]


def topics(
    shape: Shape,
    *,
    sensors: tuple[str, ...],
    human_joints: tuple[str, ...],
    landmarks: tuple[str, ...],
    dt: float,
    robot: RobotBody | None,
    truth: tuple[str, ...] = (),
) -> list[Topic]:
    """List every topic with cycles in it; those of a robot only where there is one. truth: names of its numbers."""
    often, seldom = _every(EVERY_S, dt), _every(SELDOM_S, dt)
    own = [
        _topic(
            SENSORS,
            "geometry_msgs/msg/PoseArray",
            sensors,
            lambda cycles: np.asarray(cycles.sampled == Done.WELL),
            lambda cycles: {"poses": _poses(cycles.sensor_position, _turned(cycles.sensor_orientation))},
            {"poses": len(sensors)},
        ),
        _tick(shape),
        _points(HUMAN_JOINTS, human_joints, seldom, lambda cycles: cycles.human_joints),
        _numbers(HUMAN_POSTURE, (), shape.human, seldom if robot is not None else _kept, lambda cycles: cycles.human_q),
    ]
    if robot is None:
        return own
    own += [*_of_servos(robot.joint_map, seldom), _frames(robot, seldom)]
    own += [_numbers(TRUTH, truth, len(truth), often, lambda cycles: cycles.truth)] if truth else []
    return [*own, _points(LANDMARKS, landmarks, often, lambda cycles: cycles.landmarks)]


def _kept(cycles: Cycles) -> NDArray[np.bool_]:
    return cycles.kept


def _every(seconds: float, dt: float) -> Which:
    """Kept cycles, so many seconds apart."""
    step = max(round(seconds / dt), 1)
    return lambda cycles: cycles.kept & (cycles.index % step == 0)


def _rounded(values: FloatArray) -> FloatArray:
    """To whole STEPs."""
    return np.asarray(np.rint(values / STEP) * STEP)


def _turned(orientation: FloatArray) -> FloatArray:
    """Quaternions (..., 4) wxyz as ROS has them, xyzw; the identity where they are not known."""
    unknown = np.isnan(orientation).any(axis=-1, keepdims=True)
    return np.where(unknown, [0.0, 0.0, 0.0, 1.0], orientation[..., [1, 2, 3, 0]])


def _poses(points: FloatArray, turns: FloatArray | None = None) -> FloatArray:
    """Poses (..., 7), of ROS: points (..., 3) m, turned by turns (..., 4) xyzw, else not turned."""
    turns = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*points.shape[:-1], 4)) if turns is None else turns
    return np.concatenate([points, turns], axis=-1)


def _topic(name: str, message: str, names: tuple[str, ...], which: Which, values: Values, given: Given) -> Topic:
    return Topic(name, message, names, layout_of(message, {"frame_id": WORLD} | dict(given)), which, values)


def _points(topic: str, names: tuple[str, ...], which: Which, of: Callable[[Cycles], FloatArray]) -> Topic:
    """Points as poses that are not turned."""
    values = lambda cycles: {"poses": _poses(_rounded(of(cycles)))}  # noqa: E731
    return _topic(topic, "geometry_msgs/msg/PoseArray", names, which, values, {"poses": len(names)})


def _numbers(topic: str, names: tuple[str, ...], size: int, which: Which, of: Callable[[Cycles], FloatArray]) -> Topic:
    """A posture, or other numbers (size,), in single precision."""
    return _topic(topic, "retarget_msgs/msg/Posture", names, which, lambda cycles: {"q": of(cycles)}, {"q": size})


def _of_servos(servos: JointMap, seldom: Which) -> list[Topic]:
    """Where the joints were, by what the servos said; what was sent, before it was rounded to ticks, in single
    precision, far finer than those; and all that the servos said."""
    names, state = servos.joints, "sensor_msgs/msg/JointState"
    given: Given = {"frame_id": "", "name": names, "position": len(names)}

    def joints(cycles: Cycles) -> dict[str, NDArray[Any]]:
        position, velocity = servos.to_radians(cycles.position), servos.joint_velocity(cycles.velocity)
        return {"position": _rounded(position), "velocity": _rounded(velocity)}

    return [
        _topic(
            *(JOINTS, state, names, lambda cycles: seldom(cycles) & (cycles.read == Done.WELL), joints),
            dict(given) | {"velocity": len(names)},
        ),
        _topic(GOALS, state, names, _kept, lambda cycles: {"position": cycles.q}, given),
        _topic(
            SERVOS,
            "retarget_msgs/msg/Servos",
            names,
            lambda cycles: np.asarray(cycles.read != Done.NOT),
            lambda cycles: {name: getattr(cycles, own) for name, own in (BUS_FIELDS | SERVO_FIELDS).items()},
            dict(given) | dict.fromkeys(SERVO_FIELDS, len(names)),
        ),
    ]


BUS_FIELDS = {"bus_time": "bus_time", "answer": "read", "retries": "retries", "error_rate": "error_rate"}
"""Fields of every reading of the servos: name, and name in `Cycles`."""
_OF_EACH = ("position", "velocity", "current", "voltage", "temperature", "age", "error", "alert", "valid", "driven")
SERVO_FIELDS = {name: name for name in _OF_EACH}
"""Fields of every servo, as it reported them."""


def _frames(robot: RobotBody, which: Which) -> Topic:
    """Every link of the robot in the world, in the posture that was sent."""
    body, links = robot.body.solver_body(), list(range(1, len(robot.body.body_names)))
    names = tuple(robot.body.body_names[link] for link in links)
    given: dict[str, str | tuple[str, ...]] = {"transforms": names}
    for name in names:
        given |= {f"{name}.frame_id": WORLD, f"{name}.child_frame_id": name}

    def values(cycles: Cycles) -> dict[str, NDArray[Any]]:
        q = sent_postures(robot, cycles)
        points = _rounded(body.points(q, links, np.zeros((len(links), 3))))
        poses = _poses(points, _rounded(_turned(body.orientations(q, links))))
        return {f"{name}.pose": poses[:, place] for place, name in enumerate(names)}

    return _topic(FRAMES, "tf2_msgs/msg/TFMessage", names, which, values, given)


def sent_postures(robot: RobotBody, cycles: Cycles) -> FloatArray:
    """Postures (T, nq), m, wxyz and rad, of the robot that were sent in the cycles."""
    q = np.empty((len(cycles), robot.body.nq))
    q[:, robot.servo_columns] = cycles.q
    q[:, np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)] = cycles.rest
    return q


_SAME = (
    *("tick", "asked", "phase", "state", "sampled", "written", "kept", "gated", "no_command", "readings", "settled"),
    *("clock", "goal", "sensor_weight", "weighted", "sensor_valid", "observer_modes", "human_observer_modes", "cost"),
)
TICK_FIELDS = {"cycle": "index", "root": "rest"} | {name: name for name in _SAME}
"""Fields of every cycle: name, and name in `Cycles`."""


def _tick(shape: Shape) -> Topic:
    """What else a replay needs, and what the guard did."""

    def values(cycles: Cycles) -> dict[str, NDArray[Any]]:
        oriented = ~np.isnan(cycles.sensor_orientation).any(axis=2) & (cycles.sampled == Done.WELL)[:, None]
        return {name: getattr(cycles, own) for name, own in TICK_FIELDS.items()} | {"sensor_oriented": oriented}

    sizes = {"clock": READINGS, "goal": shape.servos, "root": shape.rest, "cost": 3}
    sizes |= dict.fromkeys(("sensor_weight", "sensor_valid", "sensor_oriented"), shape.sensors)
    sizes |= {"observer_modes": shape.observers, "human_observer_modes": shape.human_observers}
    given = {"frame_id": ""} | sizes
    return _topic(TICK, "retarget_msgs/msg/Tick", (), lambda cycles: cycles.index >= 0, values, given)
