"""The run table: a row per tick. Arrays in memory, topics of a recording, keys of `--save` and the reference in the
docs follow from its list of fields. Positions are in the world (x forward, y left, z up), quaternions wxyz."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hardware.imu import ImuSample
from retarget.types import BoolArray, FloatArray, IntArray, ModeArray

ByteArray = NDArray[np.int8]
BitArray = NDArray[np.uint32]
TextArray = NDArray[np.object_]
Widths = Mapping[str, int]
"""Sizes of the words in the shapes of fields, in one run; 0 for a missing word."""
READINGS = 8
"""Readings of the clock that are kept of a cycle, which takes five at most."""
EVERY_S = {"/landmarks": 0.04, "/truth": 0.04} | dict.fromkeys(
    ("/human/joints", "/human/posture", "/joint_states", "/tf", "/contact"), 0.08
)
"""[s] Period of topics that are for display, and can be computed from the others."""


@dataclass(frozen=True)
class RunField:
    """One field of a row. unit: "" if none. shape: of one row; a word is a width of the run.

    topic, key: of a recording's message. npz: key of `--save`. column: prefix in CSV and Parquet. "": not there. fill:
    value of an empty row.
    """

    name: str
    dtype: np.dtype[Any]
    unit: str
    meaning: str
    shape: tuple[int | str, ...]
    topic: str
    key: str
    npz: str
    column: str
    fill: float

    def sizes(self, widths: Widths) -> tuple[int, ...]:
        """The shape of one row."""
        return tuple(one if isinstance(one, int) else widths.get(one, 0) for one in self.shape)

    def room(self, rows: int, widths: Widths) -> NDArray[Any]:
        """An array for so many rows. Zeros are allocated lazily, since a long run is not filled before its first
        tick."""
        shape = (rows, *self.sizes(widths))
        return np.full(shape, self.fill, self.dtype) if self.fill else np.zeros(shape, self.dtype)


def _field(
    unit: str, meaning: str, *shape: int | str, topic: str = "", npz: str = "", column: str = "", fill: float = 0.0
) -> Any:
    """A field with the dtype of its annotation. topic: "/tick", or "/tick.key". npz: "." for its own name."""
    place, _, key = topic.partition(".")
    given = {"unit": unit, "meaning": meaning, "shape": shape, "topic": place, "key": key, "npz": npz}
    return field(default=None, metadata=given | {"column": column, "fill": fill})


def _stage(meaning: str) -> Any:
    return _field("s", f"{meaning}; on the run's clock, NaN: not known", topic="/tick", npz=".", fill=np.nan)


@dataclass(frozen=True, eq=False, kw_only=True)
class RunTable:
    """Rows of a run: known fields are arrays with a row per tick, others None."""

    time: FloatArray = _field("s", "0 at the first tick of following, before it negative", npz=".")
    index: IntArray = _field("", "number of the cycle, 0 is that of arming", topic="/tick.cycle")
    tick: IntArray = _field("", "tick of the performance", topic="/tick")
    phase: ByteArray = _field("", "`Phase`: 0 approach, 1 follow, 2 brake", topic="/tick", npz=".")
    state: ModeArray = _field("", "state of the run, counted in the order of `RunState`", topic="/tick")
    kept: BoolArray = _field("", "the tick was completed; what follows from it is known only then", topic="/tick")
    gated: BoolArray = _field("", "the gate sent another goal than the desired one", topic="/tick", npz=".")
    no_command: BoolArray = _field("", "there was no goal, and the gate braked by itself", topic="/tick")
    cost: FloatArray = _field(
        "s", "thread CPU of both stages, NaN: did not run; wall time of the tick", 3, topic="/tick", fill=np.nan
    )
    asked: BitArray = _field("", "`InputFlag` bits of the cycle", topic="/tick")
    clock: FloatArray = _field("s", "what the clock said", READINGS, topic="/tick")
    readings: ModeArray = _field("", "number of readings of the clock", topic="/tick")
    velocity_command: FloatArray = _field(
        "m/s, rad/s",
        "twist that a stick asks of the robot: forward, left, up, and turns about these; NaN: there is none",
        6,
        topic="/cmd_vel.twist",
        fill=np.nan,
    )

    time_captured: FloatArray = _stage("when the newest frame of a stream was captured")
    time_arrived: FloatArray = _stage("when that frame arrived")
    time_shown: FloatArray = _stage("when the poses of the sample were captured, a playout delay before that")
    time_used: FloatArray = _stage("when the sample was taken for this tick")
    time_human: FloatArray = _stage("when the human was solved")
    time_robot: FloatArray = _stage("when the robot was solved")
    time_gate: FloatArray = _stage("when the gate had passed the goal")
    time_written: FloatArray = _stage("when the goal was written to the bus")
    time_read: FloatArray = _stage("when the servos were read")

    sampled: ModeArray = _field("", "`Done`: what became of the sample", topic="/tick")
    sensor_position: FloatArray = _field("m", "sensors as they were followed", "sensors", 3, topic="/sensors.poses")
    sensor_orientation: FloatArray = _field("", "their quaternions", "sensors", 4, topic="/sensors.poses")
    sensor_valid: BoolArray = _field("", "which of them are valid", "sensors", topic="/tick")
    sensors: FloatArray = _field(
        "m", "sensors of which the human was made; NaN: not valid", "sensors", 3, npz="sensor_positions"
    )

    human_q: FloatArray = _field("m, rad", "posture of the human", "human", topic="/human/posture.q", npz=".")
    human_joints: FloatArray = _field(
        "m", "centres of its joints", "joints", 3, topic="/human/joints.poses", npz="human_joint_positions"
    )
    human_truth: FloatArray = _field("m", "the same, as the file knows them", "joints", 3, npz=".")
    human_observer_modes: ModeArray = _field("", "modes of the human's observers", "human_observers", topic="/tick")
    balance_error: FloatArray = _field("m", "of its centre of mass from the goal; NaN outside of following")

    q: FloatArray = _field("m, rad", "posture sent to the robot, not rounded, with the root that is assumed", "robot")
    q_servos: FloatArray = _field("rad", "its coordinates that servos move", "servos", topic="/goals.position")
    q_rest: FloatArray = _field("m, rad", "its other coordinates", "rest", topic="/tick.root")
    goals: FloatArray = _field("rad", "goals of the gate: the posture, or more where it compensates a load", "servos")
    goal_ticks: IntArray = _field(
        "ticks", "the same, as written", "servos", topic="/tick.goal", npz=".", column="ticks_"
    )
    landmarks_asked: FloatArray = _field(
        "m", "landmarks asked for", "landmarks", 3, topic="/landmarks.poses", npz=".", column="asked_"
    )
    landmarks_reached: FloatArray = _field("m", "landmarks in the posture sent", "landmarks", 3, npz=".")
    observer_modes: ModeArray = _field("", "modes of the robot's observers", "observers", topic="/tick")

    written: ModeArray = _field("", "`Done`: what became of the write", topic="/tick")
    read: ModeArray = _field("", "`Done`: what became of the read at the start of the tick", topic="/servos.answer")
    bus_time: FloatArray = _field("s", "when the servos were read, on the bus's clock", topic="/servos")
    present: FloatArray = _field("rad", "where the servos were", "servos", npz="servo_positions", column="servo_")
    faults: IntArray = _field("", "servos that did not answer or reported an alert")
    position: IntArray = _field("ticks", "of each servo: where it was", "servos", topic="/servos")
    velocity: FloatArray = _field("rad/s", "its velocity", "servos", topic="/servos")
    current: FloatArray = _field("A", "its current", "servos", topic="/servos")
    voltage: FloatArray = _field("V", "its voltage", "servos", topic="/servos")
    temperature: FloatArray = _field("deg C", "its temperature", "servos", topic="/servos")
    age: FloatArray = _field("s", "age of its answer", "servos", topic="/servos")
    unexplained: FloatArray = _field(
        "N m",
        "torque that its joint does not need, see `ContactDetector`; NaN: not known",
        "servos",
        topic="/contact.effort",
        npz="unexplained_torque",
        fill=np.nan,
    )
    error: ModeArray = _field("", "its error bits", "servos", topic="/servos")
    alert: ModeArray = _field("", "its alert bits", "servos", topic="/servos")
    valid: BoolArray = _field("", "it answered", "servos", topic="/servos")
    driven: BoolArray = _field("", "it has torque", "servos", topic="/servos")
    retries: IntArray = _field("", "requests repeated since the bus was opened", topic="/servos")
    error_rate: FloatArray = _field("", "share of requests that failed of late", topic="/servos")

    imu_time: FloatArray = _field(
        "s",
        "when the IMU measured, on the bus's clock; -inf: never yet, NaN: no IMU",
        topic="/imu.time",
        npz=".",
        fill=np.nan,
    )
    imu_orientation: FloatArray = _field(
        "", "orientation of its link, z up, any yaw", 4, topic="/imu.orientation", npz=".", fill=np.nan
    )
    imu_angular_velocity: FloatArray = _field(
        "rad/s", "along the axes of that link", 3, topic="/imu.angular_velocity", npz=".", fill=np.nan
    )
    imu_acceleration: FloatArray = _field(
        "m/s^2", "specific force, along the same", 3, topic="/imu.acceleration", npz=".", fill=np.nan
    )
    imu_valid: BoolArray = _field("", "it is fresh, and the sensor works", topic="/imu.valid", npz=".")
    imu_age: FloatArray = _field("s", "its age", topic="/imu.age", npz=".", fill=np.nan)

    truth: FloatArray = _field("m, rad", "state of a simulated body, see `truth_names`", "truth", topic="/truth.q")
    obstacles: FloatArray = _field("m", "poses of the obstacles of the scene", "obstacles", 7)
    latency: FloatArray = _field("s", "from a live frame to goals, of late")
    doing: TextArray = _field("", "what the robot does, in words")
    reason: TextArray = _field("", "why it stopped, in words")

    @classmethod
    def empty(cls, rows: int, widths: Widths, names: Iterable[str] = (), **given: Any) -> Self:
        """Room for so many rows of some fields, or of all. given: other attributes."""
        return cls(**{name: FIELDS[name].room(rows, widths) for name in names or FIELDS}, **given)

    @property
    def known(self) -> dict[str, Any]:
        """The arrays of the known fields."""
        return {name: value for name, value in vars(self).items() if name in FIELDS and value is not None}

    def __contains__(self, name: str) -> bool:
        """True if a field is known."""
        return getattr(self, name) is not None

    def __len__(self) -> int:
        return len(next(iter(self.known.values())))

    def each(self, change: Callable[[NDArray[Any]], Any]) -> Self:
        """The table with every array changed."""
        return replace(self, **{name: change(value) for name, value in self.known.items()})

    def __getitem__(self, rows: Any) -> Self:
        """The rows of an index, a slice or a mask."""
        return self.each(lambda array: array[rows])


def _fields() -> dict[str, RunField]:
    made = {}
    for one in fields(RunTable):
        given = dict(one.metadata)
        given["key"] = given["key"] or one.name
        given["npz"] = one.name if given["npz"] == "." else given["npz"]
        dtype = np.dtype(one.type.__args__[1].__args__[0])  # type: ignore[union-attr]
        made[one.name] = RunField(name=one.name, dtype=dtype, **given)
    return made


def imu_of(rows: RunTable, at: int) -> ImuSample | None:
    """The measurement in a row."""
    time, orientation = float(rows.imu_time[at]), rows.imu_orientation[at].copy()
    if np.isnan(time):
        return None
    return ImuSample(
        time,
        None if np.isnan(orientation).any() else orientation,
        rows.imu_angular_velocity[at].copy(),
        rows.imu_acceleration[at].copy(),
        bool(rows.imu_valid[at]),
        float(rows.imu_age[at]),
    )


FIELDS = _fields()
"""Every field by its name."""
OF_IMU = tuple(name for name in FIELDS if name.startswith("imu_"))
"""Fields of the IMU; absent in older files, and for robots without one."""
STAGES = tuple(name for name in FIELDS if name.startswith("time_"))
"""Times of a tick's stages; absent in older files."""


def message_fields(topic: str) -> dict[str, str]:
    """Fields of a topic's messages, by their names there."""
    return {one.key: name for name, one in FIELDS.items() if one.topic == topic}
