"""The topics of a recording: the message of each, how cycles become messages, and the definitions that ROS 2 knows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from hardware.joint_map import JointMap
from retarget.model.robot import RobotBody
from retarget.recording.cdr import CdrBuilder, CdrLayout, Rows
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
    messages, as a mask (T,). fill: from messages with their stamps and cycles, writes everything else."""

    name: str
    schema: str
    names: tuple[str, ...]
    layout: CdrLayout
    which: Callable[[Cycles], Mask]
    fill: Callable[[Rows, Cycles], None]

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
        self.fill(rows, taken)
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


def _sensors(names: tuple[str, ...]) -> Topic:
    """What the sensors said, bit by bit: replay begins with it."""

    def fill(rows: Rows, cycles: Cycles) -> None:
        rows["poses"][..., :3], rows["poses"][..., 3:] = cycles.sensor_position, _turned(cycles.sensor_orientation)

    layout = CdrBuilder().header(WORLD).poses("poses", len(names)).build()
    return Topic(
        SENSORS,
        "geometry_msgs/msg/PoseArray",
        names,
        layout,
        lambda cycles: np.asarray(cycles.sampled == Done.WELL),
        fill,
    )


def _points(
    topic: str, names: tuple[str, ...], which: Callable[[Cycles], Mask], of: Callable[[Cycles], FloatArray]
) -> Topic:
    """Points as poses that are not turned."""

    def fill(rows: Rows, cycles: Cycles) -> None:
        rows["poses"][..., :3], rows["poses"][..., 6] = _rounded(of(cycles)), 1.0

    layout = CdrBuilder().header(WORLD).poses("poses", len(names)).build()
    return Topic(topic, "geometry_msgs/msg/PoseArray", names, layout, which, fill)


def _numbers(
    topic: str, names: tuple[str, ...], size: int, which: Callable[[Cycles], Mask], of: Callable[[Cycles], FloatArray]
) -> Topic:
    """A posture, or other numbers (size,), in single precision."""

    def fill(rows: Rows, cycles: Cycles) -> None:
        rows["q"] = of(cycles)

    layout = CdrBuilder().header(WORLD).sequence("q", "float32", size).build()
    return Topic(topic, "retarget_msgs/msg/Posture", names, layout, which, fill)


def _joints(servos: JointMap, which: Callable[[Cycles], Mask]) -> Topic:
    """Where the joints were, by what the servos said."""

    def fill(rows: Rows, cycles: Cycles) -> None:
        rows["position"] = _rounded(servos.to_radians(cycles.position))
        rows["velocity"] = _rounded(servos.joint_velocity(cycles.velocity))

    names = servos.joints
    builder = CdrBuilder().header("").texts(names).sequence("position", "float64", len(names))
    layout = builder.sequence("velocity", "float64", len(names)).count(0).build()
    return Topic(
        JOINTS,
        "sensor_msgs/msg/JointState",
        names,
        layout,
        lambda cycles: which(cycles) & (cycles.read == Done.WELL),
        fill,
    )


def _goals(names: tuple[str, ...]) -> Topic:
    """What was sent, before it was rounded to ticks; in single precision, far finer than those."""

    def fill(rows: Rows, cycles: Cycles) -> None:
        rows["position"] = cycles.q.astype(np.float32)

    builder = CdrBuilder().header("").texts(names).sequence("position", "float64", len(names))
    return Topic(GOALS, "sensor_msgs/msg/JointState", names, builder.count(0).count(0).build(), _kept, fill)


SERVO_FIELDS = (
    *(("position", "int32"), ("velocity", "float64"), ("current", "float64"), ("voltage", "float64")),
    *(("temperature", "float64"), ("age", "float64"), ("error", "uint8"), ("alert", "uint8")),
    *(("valid", "bool"), ("driven", "bool")),
)
"""Of every servo, as it said them."""


def _servos(servos: JointMap) -> Topic:
    names = servos.joints
    builder = CdrBuilder().header("").texts(names).scalar("bus_time", "float64").scalar("answer", "uint8")
    builder.scalar("retries", "int32").scalar("error_rate", "float64")
    for field, kind in SERVO_FIELDS:
        builder.sequence(field, kind, len(names))

    def fill(rows: Rows, cycles: Cycles) -> None:
        rows["bus_time"], rows["answer"], rows["retries"] = cycles.bus_time, cycles.read, cycles.retries
        rows["error_rate"] = cycles.error_rate
        for field, _ in SERVO_FIELDS:
            rows[field] = getattr(cycles, field)

    return Topic(
        SERVOS,
        "retarget_msgs/msg/Servos",
        names,
        builder.build(),
        lambda cycles: np.asarray(cycles.read != Done.NOT),
        fill,
    )


def _frames(robot: RobotBody, which: Callable[[Cycles], Mask]) -> Topic:
    """Every link of the robot in the world, in the posture that was sent."""
    body, links = robot.body.solver_body(), list(range(1, len(robot.body.body_names)))
    names = tuple(robot.body.body_names[link] for link in links)
    builder = CdrBuilder().count(len(links))
    for name in names:
        builder.time(f"{name}.stamp").text(WORLD).text(name).fixed(f"{name}.pose", "float64", 7)
    rest = np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)

    def fill(rows: Rows, cycles: Cycles) -> None:
        q = np.empty((len(cycles), robot.body.nq))
        q[:, robot.servo_columns], q[:, rest] = cycles.q, cycles.rest
        points = _rounded(body.points(q, links, np.zeros((len(links), 3))))
        turns = _rounded(_turned(body.orientations(q, links)))
        for place, name in enumerate(names):
            rows[f"{name}.pose"][:, :3], rows[f"{name}.pose"][:, 3:] = points[:, place], turns[:, place]

    return Topic(FRAMES, "tf2_msgs/msg/TFMessage", names, builder.build(), which, fill)


TICK_FIELDS = (
    *(("cycle", "uint32", "index"), ("tick", "int32", "tick"), ("asked", "uint32", "asked")),
    *(("phase", "int8", "phase"), ("state", "uint8", "state"), ("sampled", "uint8", "sampled")),
    *(("written", "uint8", "written"), ("kept", "bool", "kept"), ("gated", "bool", "gated")),
    *(("no_command", "bool", "no_command"), ("readings", "uint8", "readings"), ("settled", "float64", "settled")),
)
"""Of every cycle: name, kind, and name in `Cycles`."""


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

    def fill(rows: Rows, cycles: Cycles) -> None:
        for name, _, own in TICK_FIELDS:
            rows[name] = getattr(cycles, own)
        said = np.arange(READINGS) < cycles.readings[:, None]
        rows["clock"] = np.where(said, cycles.clock, 0.0)
        asked = (cycles.sampled == Done.WELL)[:, None]
        rows["weighted"] = cycles.weighted & asked[:, 0]
        rows["sensor_valid"] = cycles.sensor_valid & asked
        rows["sensor_oriented"] = ~np.isnan(cycles.sensor_orientation).any(axis=2) & asked
        rows["sensor_weight"] = np.where(rows["weighted"][:, None], cycles.sensor_weight, 0.0)
        rows["cost"] = cycles.cost
        for name, values in (
            ("goal", cycles.goal),
            ("root", cycles.rest),
            ("observer_modes", cycles.observer_modes),
            ("human_observer_modes", cycles.human_observer_modes),
        ):
            if name in (rows.dtype.names or ()):
                rows[name] = values

    return Topic(TICK, "retarget_msgs/msg/Tick", (), builder.build(), lambda cycles: cycles.index >= 0, fill)


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
