"""The topics of a recording: the message of each, how cycles become messages, and the definitions that ROS 2 knows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.joint_map import JointMap
from retarget.model.robot import RobotBody
from retarget.recording.cdr import CdrBuilder, CdrLayout
from retarget.recording.cycles import READINGS, Cycles, Done, Shape
from retarget.types import FloatArray

SENSORS, JOINTS, GOALS, SERVOS, TICK = "/sensors", "/joint_states", "/goals", "/servos", "/tick"
LANDMARKS, HUMAN_JOINTS, HUMAN_POSTURE, FRAMES = "/landmarks", "/human/joints", "/human/posture", "/tf"
EVENTS, TRUTH = "/events", "/truth"
WORLD = "world"
EVERY_S, SELDOM_S = 0.04, 0.08
"""Between two messages of what is there to be looked at, and can be computed again from the rest."""
STEP = 2.0**-16
"""Of such numbers, m or rad: 15 um. Most of their bytes are then zeros."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Topic:
    """name, schema: as in the file. names: of what its arrays hold, for its metadata. which: the cycles that become
    messages, as a mask (T,). values: of cycles (T), the fields of their messages by name, without their stamps."""

    name: str
    schema: str
    names: tuple[str, ...]
    layout: CdrLayout
    which: Callable[[Cycles], Mask]
    values: Callable[[Cycles], dict[str, NDArray[Any]]]

    def messages(self, cycles: Cycles, stamp_ns: NDArray[np.int64]) -> Iterator[tuple[int, int, bytes]]:
        """Of some cycles that began at `stamp_ns` (T,): number of the cycle, stamp in ns and bytes of each message."""
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
    """Every topic with cycles in it; those of a robot only where there is one. truth: names of its numbers."""
    often, seldom = _every(EVERY_S, dt), _every(SELDOM_S, dt)
    own = [
        _sensors(sensors),
        _tick(shape),
        _points(HUMAN_JOINTS, human_joints, seldom, lambda cycles: cycles.human_joints),
        _numbers(HUMAN_POSTURE, (), shape.human, seldom if robot is not None else _kept, lambda cycles: cycles.human_q),
    ]
    if robot is None:
        return own
    servos = robot.joint_map
    own += [_joints(servos, seldom), _goals(servos.joints), _servos(servos), _frames(robot, seldom)]
    own += [_numbers(TRUTH, truth, len(truth), often, lambda cycles: cycles.truth)] if truth else []
    return [*own, _points(LANDMARKS, landmarks, often, lambda cycles: cycles.landmarks)]


def _kept(cycles: Cycles) -> Mask:
    return cycles.kept


def _every(seconds: float, dt: float) -> Callable[[Cycles], Mask]:
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


def _poses(points: FloatArray, turns: FloatArray | None = None) -> dict[str, NDArray[Any]]:
    """Poses (..., 7), of ROS: points (..., 3) m, turned by turns (..., 4) xyzw, else not turned."""
    turns = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*points.shape[:-1], 4)) if turns is None else turns
    return {"poses": np.concatenate([points, turns], axis=-1)}


def _sensors(names: tuple[str, ...]) -> Topic:
    """What the sensors said, bit by bit: replay begins with it."""
    return Topic(
        SENSORS,
        "geometry_msgs/msg/PoseArray",
        names,
        CdrBuilder().header(WORLD).poses("poses", len(names)).build(),
        lambda cycles: np.asarray(cycles.sampled == Done.WELL),
        lambda cycles: _poses(cycles.sensor_position, _turned(cycles.sensor_orientation)),
    )


def _points(
    topic: str, names: tuple[str, ...], which: Callable[[Cycles], Mask], of: Callable[[Cycles], FloatArray]
) -> Topic:
    """Points as poses that are not turned."""
    layout = CdrBuilder().header(WORLD).poses("poses", len(names)).build()
    values = lambda cycles: _poses(_rounded(of(cycles)))  # noqa: E731
    return Topic(topic, "geometry_msgs/msg/PoseArray", names, layout, which, values)


def _numbers(
    topic: str, names: tuple[str, ...], size: int, which: Callable[[Cycles], Mask], of: Callable[[Cycles], FloatArray]
) -> Topic:
    """A posture, or other numbers (size,), in single precision."""
    layout = CdrBuilder().header(WORLD).sequence("q", "float32", size).build()
    return Topic(topic, "retarget_msgs/msg/Posture", names, layout, which, lambda cycles: {"q": of(cycles)})


def _joints(servos: JointMap, which: Callable[[Cycles], Mask]) -> Topic:
    """Where the joints were, by what the servos said."""
    names = servos.joints
    builder = CdrBuilder().header("").texts(names).sequence("position", "float64", len(names))
    return Topic(
        JOINTS,
        "sensor_msgs/msg/JointState",
        names,
        builder.sequence("velocity", "float64", len(names)).count(0).build(),
        lambda cycles: which(cycles) & (cycles.read == Done.WELL),
        lambda cycles: {
            "position": _rounded(servos.to_radians(cycles.position)),
            "velocity": _rounded(servos.joint_velocity(cycles.velocity)),
        },
    )


def _goals(names: tuple[str, ...]) -> Topic:
    """What was sent, before it was rounded to ticks; in single precision, far finer than those."""
    builder = CdrBuilder().header("").texts(names).sequence("position", "float64", len(names))
    layout = builder.count(0).count(0).build()
    values = lambda cycles: {"position": cycles.q.astype(np.float32)}  # noqa: E731
    return Topic(GOALS, "sensor_msgs/msg/JointState", names, layout, _kept, values)


BUS_FIELDS = (
    *(("bus_time", "float64", "bus_time"), ("answer", "uint8", "read")),
    *(("retries", "int32", "retries"), ("error_rate", "float64", "error_rate")),
)
"""Of every reading of the servos: name, kind, and name in `Cycles`."""
SERVO_FIELDS = (
    *(("position", "int32"), ("velocity", "float64"), ("current", "float64"), ("voltage", "float64")),
    *(("temperature", "float64"), ("age", "float64"), ("error", "uint8"), ("alert", "uint8")),
    *(("valid", "bool"), ("driven", "bool")),
)
"""Of every servo, as it said them."""


def _servos(servos: JointMap) -> Topic:
    names = servos.joints
    builder = CdrBuilder().header("").texts(names)
    for field, kind, _ in BUS_FIELDS:
        builder.scalar(field, kind)
    for field, kind in SERVO_FIELDS:
        builder.sequence(field, kind, len(names))
    owns = {field: own for field, _, own in BUS_FIELDS} | {field: field for field, _ in SERVO_FIELDS}
    return Topic(
        SERVOS,
        "retarget_msgs/msg/Servos",
        names,
        builder.build(),
        lambda cycles: np.asarray(cycles.read != Done.NOT),
        lambda cycles: {field: getattr(cycles, own) for field, own in owns.items()},
    )


def _frames(robot: RobotBody, which: Callable[[Cycles], Mask]) -> Topic:
    """Every link of the robot in the world, in the posture that was sent."""
    body, links = robot.body.solver_body(), list(range(1, len(robot.body.body_names)))
    names = tuple(robot.body.body_names[link] for link in links)
    builder = CdrBuilder().count(len(links))
    for name in names:
        builder.time(f"{name}.stamp").text(WORLD).text(name).fixed(f"{name}.pose", "float64", 7)

    def values(cycles: Cycles) -> dict[str, NDArray[Any]]:
        q = sent_postures(robot, cycles)
        points = _rounded(body.points(q, links, np.zeros((len(links), 3))))
        poses = _poses(points, _rounded(_turned(body.orientations(q, links))))["poses"]
        return {f"{name}.pose": poses[:, place] for place, name in enumerate(names)}

    return Topic(FRAMES, "tf2_msgs/msg/TFMessage", names, builder.build(), which, values)


def sent_postures(robot: RobotBody, cycles: Cycles) -> FloatArray:
    """Postures (T, nq) of the robot that were sent in the cycles."""
    q = np.empty((len(cycles), robot.body.nq))
    q[:, robot.servo_columns] = cycles.q
    q[:, np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)] = cycles.rest
    return q


TICK_FIELDS = (
    *(("cycle", "uint32", "index"), ("tick", "int32", "tick"), ("asked", "uint32", "asked")),
    *(("phase", "int8", "phase"), ("state", "uint8", "state"), ("sampled", "uint8", "sampled")),
    *(("written", "uint8", "written"), ("kept", "bool", "kept"), ("gated", "bool", "gated")),
    *(("no_command", "bool", "no_command"), ("readings", "uint8", "readings"), ("settled", "float64", "settled")),
)
"""Of every cycle: name, kind, and name in `Cycles`."""
TICK_ARRAYS = {
    **{name: name for name in ("clock", "goal", "sensor_weight", "weighted", "sensor_valid", "cost")},
    "root": "rest",
    "observer_modes": "observer_modes",
    "human_observer_modes": "human_observer_modes",
}
"""More of every cycle: name, and name in `Cycles`."""


def _tick(shape: Shape) -> Topic:
    """What else a replay needs, and what the guard did."""
    builder = CdrBuilder().header("")
    for name, kind, _ in TICK_FIELDS:
        builder.scalar(name, kind)
    builder.sequence("clock", "float64", READINGS).sequence("goal", "int32", shape.servos)
    builder.sequence("root", "float32", shape.rest).sequence("sensor_weight", "float64", shape.sensors)
    builder.scalar("weighted", "bool").sequence("sensor_valid", "bool", shape.sensors)
    builder.sequence("sensor_oriented", "bool", shape.sensors)
    builder.sequence("observer_modes", "uint8", shape.observers)
    builder.sequence("human_observer_modes", "uint8", shape.human_observers).sequence("cost", "float32", 3)
    owns = {name: own for name, _, own in TICK_FIELDS} | TICK_ARRAYS

    def values(cycles: Cycles) -> dict[str, NDArray[Any]]:
        oriented = ~np.isnan(cycles.sensor_orientation).any(axis=2) & (cycles.sampled == Done.WELL)[:, None]
        return {name: getattr(cycles, own) for name, own in owns.items()} | {"sensor_oriented": oriented}

    return Topic(TICK, "retarget_msgs/msg/Tick", (), builder.build(), lambda cycles: cycles.index >= 0, values)


# The messages of a recording as ROS 2 defines them (`ros2msg`): standard ones wherever there is one.

_LINE = "=" * 80 + "\n"
_PARTS = files("retarget.recording").joinpath("ros2_messages.txt").read_text(encoding="utf-8").split(f"{_LINE}MSG: ")
_OWN = {name: text for name, _, text in (part.removeprefix("MSG: ").partition("\n") for part in _PARTS)}


def _made_of(name: str) -> dict[str, None]:
    """The messages that one is made of, itself first, each once."""
    names = {name: None}
    for field in _OWN[name].split("\n"):
        kind = field.partition(" ")[0].removesuffix("[]")
        names |= _made_of(kind) if kind in _OWN else {}
    return names


def schema(name: str) -> str:
    """The definition of a message by its full name, followed by those that it is made of. docs/results.md explains
    the fields."""
    own, *others = _made_of(name.replace("/msg/", "/"))
    return _OWN[own] + "".join(f"{_LINE}MSG: {other}\n{_OWN[other]}" for other in others)
