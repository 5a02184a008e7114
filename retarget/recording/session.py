"""The session of a recording: the data of a run that replay needs besides the cycles, strictly validated."""

import hashlib
import platform
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

import retarget
from retarget.human.sensor_intake import IntakeTimes
from retarget.model.human_dimensions import POINTS, HumanDimensions
from retarget.model.robot import RobotBody
from retarget.run.options import PhysicsOptions, RunOptions, priority_names
from retarget.run.prepare import Prepared
from retarget.run.rest_trajectory import EndPlan
from retarget.run.supervisor import End
from retarget.schema.catalogue import Kind, calibration_path, find
from retarget.schema.priorities import Legs, Steps, self_contained

FORMAT: Final = 3
"""Format of recordings; others are refused. Version 0.1.0 wrote format 1."""

OPTIONS = (
    *("robot", "bus", "performer", "priorities", "iterations", "parts", "steps", "legs"),
    *("gate", "scene", "allow_contact", "max_force"),
)
OF_PHYSICS = ("mount", "hook", "seed", "perturbations")
"""Session fields taken from `RunOptions` and from `PhysicsOptions`."""
NotNegative = Annotated[float, Field(ge=0.0)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ConfigFile(_Strict):
    """A config file of the run. name: of the attachment. path: its original place."""

    name: str
    path: str
    sha256: str


class Size(_Strict):
    """The performer's size, see `HumanDimensions`."""

    offset: Annotated[tuple[tuple[float, float, float], ...], Field(min_length=len(POINTS), max_length=len(POINTS))]
    stature: float
    mass: float
    origin: str


class Session(_Strict):
    """A run. version, numpy, machine: its computing environment. Options as in `RunOptions`; ticks, dt, motion_dt: of
    its samples; intake: hold, fade, speed, turn."""

    format: Literal[3]
    version: str
    numpy: str
    machine: str
    source: str
    robot: str
    bus: str
    performer: str
    priorities: str | None
    iterations: int | None
    parts: Literal["whole", "upper"]
    steps: Steps | Literal["shift"] | None = None  # none before there were any; `shift` stepped in place, until 0.2
    legs: Legs | None = None
    gate: bool
    scene: str | None
    allow_contact: bool
    max_force: Annotated[float, Field(gt=0.0)] | None = None
    mount: str | None
    hook: str | None
    seed: int
    perturbations: tuple[str, ...]
    goes_to_rest: bool
    end: str | None = None  # in recordings of before there was a choice: at rest
    keyframes: tuple[str, ...] = ()
    ticks: Annotated[int, Field(ge=1)]
    dt: Annotated[float, Field(ge=1e-4, le=1.0)]
    motion_dt: Annotated[float, Field(ge=1e-6, le=10.0)]
    begun_ns: int
    dimensions: Size
    intake: tuple[NotNegative, ...] = Field(min_length=3, max_length=4)
    sensors: Annotated[tuple[str, ...], Field(min_length=1)]
    joints: tuple[str, ...]
    observers: tuple[str, ...]
    notes: tuple[str, ...]
    files: tuple[ConfigFile, ...]

    @property
    def options(self) -> RunOptions:
        """The options of the run."""
        physics = PhysicsOptions(**{name: getattr(self, name) for name in OF_PHYSICS})
        return RunOptions(**{name: getattr(self, name) for name in OPTIONS}, physics=physics)

    def end_plan(self, robot: RobotBody) -> EndPlan:
        """The planned end of the run."""
        if self.end is not None:
            end = End[self.end]
            return EndPlan(end, self.keyframes, "as in the recorded run" if end is End.STANDING else "")
        return EndPlan(End.AT_REST, robot.profile.postures.to_rest) if self.goes_to_rest else EndPlan()

    @property
    def size(self) -> HumanDimensions:
        """The performer's size."""
        size = self.dimensions
        return HumanDimensions(np.array(size.offset), size.stature, size.mass, size.origin)

    @property
    def intake_times(self) -> IntakeTimes:
        """Times of lost and returning sensors."""
        return IntakeTimes(*self.intake)


CPU = Path("/proc/cpuinfo")


def machine_name() -> str:
    """Machine type, with the processor if Linux names it: `x86_64 (AMD EPYC)`."""
    lines = CPU.read_text(encoding="utf-8", errors="replace").splitlines() if CPU.is_file() else []
    values = {key.strip().lower(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    processor = values.get("model name") or values.get("model")
    return platform.machine() + (f" ({processor})" if processor else "")


def session_of(prepared: Prepared, options: RunOptions, *, source: str, begun_ns: int) -> Session:
    """The session of a prepared run. begun_ns: unix time."""
    size, samples, intake = prepared.human.dimensions, prepared.samples, prepared.intake
    machine = prepared.machine
    robot, end_plan = (None, EndPlan()) if machine is None else (machine.robot, machine.end_plan)
    offset = [(float(x), float(y), float(z)) for x, y, z in size.offset]
    return Session(
        format=FORMAT,
        version=retarget.__version__,
        numpy=np.__version__,
        machine=machine_name(),
        source=source.encode(errors="replace").decode(),  # of a file whose name is not UTF-8
        **{name: getattr(options, name) for name in OPTIONS} | {"performer": options.performer_name},
        **{name: getattr(options.physics, name) for name in OF_PHYSICS},
        goes_to_rest=end_plan.end is not End.BRAKED,
        end=end_plan.end.name,
        keyframes=end_plan.keyframes,
        ticks=samples.ticks,
        dt=samples.dt,
        motion_dt=samples.motion_dt,
        begun_ns=begun_ns,
        dimensions=Size(offset=tuple(offset), stature=size.stature, mass=size.mass, origin=size.origin),
        intake=(intake.hold, intake.fade, intake.speed, intake.turn),
        sensors=tuple(prepared.performer.sensors),
        joints=() if robot is None else robot.joint_map.joints,
        observers=() if prepared.observers is None else prepared.observers.names,
        notes=prepared.notes,
        files=tuple(file for file, _ in config_files(options, robot)),
    )


def config_files(options: RunOptions, robot: RobotBody | None) -> list[tuple[ConfigFile, bytes]]:
    """The config files of a run with these options, and their content. Raises UsageError, OSError."""
    found = [("performer.yaml", find(Kind.PERFORMER, options.performer_name))]
    for stage, name in zip(("human", "robot"), priority_names(robot, options), strict=False):
        found.append((f"priorities_of_the_{stage}.yaml", find(Kind.PRIORITIES, name)))
    if options.scene is not None:
        found.append(("scene.yaml", find(Kind.SCENE, options.scene)))
    if robot is not None:
        body = robot.profile.body_path
        found += [("robot.yaml", robot.profile.path), (f"body{body.suffix}", body)]
        if robot.calibration is not None:
            found.append(("calibration.yaml", calibration_path(robot.profile.name)))
    files = []
    for name, path in found:
        content = config_content(name, path)
        files.append((ConfigFile(name=name, path=str(path), sha256=hashlib.sha256(content).hexdigest()), content))
    return files


def config_content(name: str, path: Path) -> bytes:
    """The recorded content of a file. name: of its attachment. Raises ConfigError, OSError."""
    return self_contained(path) if name.startswith("priorities") else path.read_bytes()
