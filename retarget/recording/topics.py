"""The topics of a recording, and the conversion of cycles into their messages."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.joint_map import JointMap
from retarget.model.robot import RobotBody
from retarget.recording.cdr import CdrLayout, Given, layout_of
from retarget.recording.cycles import Done
from retarget.run.table import EVERY_S, FIELDS, RunTable, Widths, message_fields
from retarget.safety.contact import felt_servos
from retarget.types import FloatArray

SENSORS, JOINTS, GOALS, SERVOS, TICK = "/sensors", "/joint_states", "/goals", "/servos", "/tick"
LANDMARKS, HUMAN_JOINTS, HUMAN_POSTURE, FRAMES = "/landmarks", "/human/joints", "/human/posture", "/tf"
EVENTS, TRUTH, IMU, CONTACT, STICK = "/events", "/truth", "/imu", "/contact", "/cmd_vel"
WORLD, POSTURE, JOINT_STATE = "world", "retarget_msgs/msg/Posture", "sensor_msgs/msg/JointState"
XYZW = [1, 2, 3, 0]
"""Columns of a quaternion wxyz in ROS order."""
STEP = 2.0**-16
"""Step, m or rad, of rounded numbers: 15 um. It makes most of their bytes 0, which compress well."""

RECORDED = ("time", *(name for name, field in FIELDS.items() if field.topic))
"""Fields of a recording."""
SERVO_FIELDS = tuple(name for name, field in FIELDS.items() if field.topic == SERVOS and field.shape)
"""Reported fields of each servo."""
Which = Callable[[RunTable], NDArray[np.bool_]]
Values = Callable[[RunTable], dict[str, NDArray[Any]]]


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic of the file. name, schema, names (of its columns): as in the file. which: mask (T,) of the cycles that
    become messages. values: fields of their messages for cycles (T), without stamps."""

    name: str
    schema: str
    names: tuple[str, ...]
    layout: CdrLayout
    which: Which
    values: Values

    def messages(self, cycles: RunTable, stamp_ns: NDArray[np.int64]) -> Iterator[tuple[int, int, bytes]]:
        """Yield cycle number, stamp in ns and bytes of each message of cycles that began at `stamp_ns` (T,)."""
        chosen = np.flatnonzero(self.which(cycles))
        if not chosen.size:
            return
        taken, stamps = cycles if len(chosen) == len(cycles) else cycles[chosen], stamp_ns[chosen]
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


def topics(widths: Widths, named: Mapping[str, tuple[str, ...]], *, dt: float, robot: RobotBody | None) -> list[Topic]:
    """The topics of a run of a robot, or of a human alone. named: column names of a width."""
    sensors = named["sensors"]

    def kept(topic: str) -> Which:
        step = max(round(EVERY_S.get(topic, 0.0) / dt), 1)
        return lambda cycles: cycles.kept & (cycles.index % step == 0)

    def fields(topic: str, message: str, names: tuple[str, ...], which: Which, **given: Any) -> Topic:
        """A topic with the fields of the table that name it."""
        own = message_fields(topic)
        sizes = {key: FIELDS[field].sizes(widths)[0] for key, field in own.items() if FIELDS[field].shape}
        values = lambda cycles: {key: getattr(cycles, field) for key, field in own.items()}  # noqa: E731
        return _topic(topic, message, names, which, values, sizes | given)

    def points(name: str, names: tuple[str, ...], field: str) -> Topic:
        values = lambda cycles: {"poses": _poses(_rounded(getattr(cycles, field)))}  # noqa: E731
        return _topic(name, "geometry_msgs/msg/PoseArray", names, kept(name), values, {"poses": len(names)})

    def oriented(cycles: RunTable) -> NDArray[np.bool_]:
        known = ~np.isnan(cycles.sensor_orientation).any(axis=2)
        return np.asarray(known & (cycles.sampled == Done.WELL)[:, None])

    alone = robot is None  # then every posture is kept: there is nothing else
    tick = fields(
        TICK, "retarget_msgs/msg/Tick", (), lambda cycles: cycles.index >= 0, frame_id="", sensor_oriented=len(sensors)
    )
    made = [
        _topic(
            SENSORS,
            "geometry_msgs/msg/PoseArray",
            sensors,
            lambda cycles: np.asarray(cycles.sampled == Done.WELL),
            lambda cycles: {"poses": _poses(cycles.sensor_position, _turned(cycles.sensor_orientation))},
            {"poses": len(sensors)},
        ),
        replace(tick, values=lambda cycles: tick.values(cycles) | {"sensor_oriented": oriented(cycles)}),
        points(HUMAN_JOINTS, named["joints"], "human_joints"),
        fields(HUMAN_POSTURE, POSTURE, (), (lambda cycles: cycles.kept) if alone else kept(HUMAN_POSTURE)),
    ]
    if robot is None:
        return made
    of_joints: dict[str, Any] = {"frame_id": "", "name": (names := robot.joint_map.joints)}
    made += [
        _joint_states(robot.joint_map, kept(JOINTS), of_joints),
        fields(GOALS, JOINT_STATE, names, kept(GOALS), **of_joints),
        fields(SERVOS, "retarget_msgs/msg/Servos", names, lambda cycles: cycles.read != Done.NOT, **of_joints),
        _frames(robot, kept(FRAMES)),
    ]
    if robot.profile.imu is not None:
        read = lambda cycles: (cycles.read != Done.NOT) & ~np.isnan(cycles.imu_time)  # noqa: E731
        imu = fields(IMU, "retarget_msgs/msg/Imu", (), read, frame_id=robot.profile.imu.link)
        turned = lambda cycles: imu.values(cycles) | {"orientation": cycles.imu_orientation[:, XYZW]}  # noqa: E731
        made.append(replace(imu, values=turned))
    if felt_servos(robot).any():
        made.append(fields(CONTACT, JOINT_STATE, names, kept(CONTACT), **of_joints))
    moved = lambda cycles: ~np.isnan(cycles.velocity_command[:, 0])  # noqa: E731
    made.append(fields(STICK, "geometry_msgs/msg/TwistStamped", (), moved, frame_id=robot.body.body_names[1]))
    if named.get("truth"):
        made.append(fields(TRUTH, POSTURE, named["truth"], kept(TRUTH)))
    return [*made, points(LANDMARKS, named["landmarks"], "landmarks_asked")]


def _rounded(values: FloatArray) -> FloatArray:
    return np.asarray(np.rint(values / STEP) * STEP)


def _turned(orientation: FloatArray) -> FloatArray:
    """Quaternions (..., 4) wxyz in ROS order xyzw; the identity if unknown."""
    unknown = np.isnan(orientation).any(axis=-1, keepdims=True)
    return np.where(unknown, [0.0, 0.0, 0.0, 1.0], orientation[..., XYZW])


def _poses(points: FloatArray, turns: FloatArray | None = None) -> FloatArray:
    """ROS poses (..., 7): points (..., 3) m, with rotations (..., 4) xyzw or none."""
    turns = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*points.shape[:-1], 4)) if turns is None else turns
    return np.concatenate([points, turns], axis=-1)


def _topic(name: str, message: str, names: tuple[str, ...], which: Which, values: Values, given: Given) -> Topic:
    return Topic(name, message, names, layout_of(message, {"frame_id": WORLD} | dict(given)), which, values)


def _joint_states(servos: JointMap, which: Which, given: Given) -> Topic:
    def values(cycles: RunTable) -> dict[str, NDArray[Any]]:
        position, velocity = servos.to_radians(cycles.position), servos.joint_velocity(cycles.velocity)
        return {"position": _rounded(position), "velocity": _rounded(velocity)}

    sizes = dict.fromkeys(("position", "velocity"), len(servos))
    read = lambda cycles: which(cycles) & (cycles.read == Done.WELL)  # noqa: E731
    return _topic(JOINTS, JOINT_STATE, servos.joints, read, values, dict(given) | sizes)


def _frames(robot: RobotBody, which: Which) -> Topic:
    body, links = robot.body.solver_body(), list(range(1, len(robot.body.body_names)))
    names = tuple(robot.body.body_names[link] for link in links)
    given: dict[str, str | tuple[str, ...]] = {"transforms": names}
    for name in names:
        given |= {f"{name}.frame_id": WORLD, f"{name}.child_frame_id": name}

    def values(cycles: RunTable) -> dict[str, NDArray[Any]]:
        q = sent_postures(robot, cycles)
        points = _rounded(body.points(q, links, np.zeros((len(links), 3))))
        poses = _poses(points, _rounded(_turned(body.orientations(q, links))))
        return {f"{name}.pose": poses[:, place] for place, name in enumerate(names)}

    return _topic(FRAMES, "tf2_msgs/msg/TFMessage", names, which, values, given)


def sent_postures(robot: RobotBody, cycles: RunTable) -> FloatArray:
    """Postures (T, nq), m, wxyz and rad, of the robot that were sent in the cycles."""
    q = np.empty((len(cycles), robot.body.nq))
    q[:, robot.servo_columns] = cycles.q_servos
    q[:, np.setdiff1d(np.arange(robot.body.nq), robot.servo_columns)] = cycles.q_rest
    return q
