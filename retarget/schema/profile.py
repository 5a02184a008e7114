"""A robot's profile: the facts that its body file lacks. `configs/robots/<name>/robot.yaml`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr

from hardware.bus import BusSpec
from hardware.imu import ImuSpec
from hardware.servo import Layout, ServoSpec, find_model
from retarget.schema.catalogue import Kind, read_as
from retarget.schema.profile_parts import (
    Bus,
    Coupling,
    Foot,
    IgnorePair,
    Imu,
    Landmark,
    Observer,
    Postures,
    ProfileFrame,
    Safety,
    Servo,
    Stiffness,
    servo_specs,
    with_stiffness,
)
from retarget.schema.strict_models import Check, Name, Schema, Text, validated


class RobotProfile(Schema):
    """A robot. Links, joints and geoms are named as in the body file."""

    name: Name
    """Name by which it is chosen; of a shipped robot that of its folder."""
    body: Text
    """Body file, MJCF or URDF, relative to the profile's folder."""
    root: Literal["free", "fixed", "suspended"]
    """free: it stands on its soles; fixed: bolted down at its first link; suspended: it hangs."""
    frames: Annotated[dict[Name, ProfileFrame], Field(max_length=200)]
    """Named points on links: hands, soles, head, and others for landmarks and tasks."""
    servos: Annotated[dict[Name, Servo], Field(min_length=1, max_length=250)]
    """One per joint that moves, by the joint's name. The order is that of every array of the servo side."""
    stiffness: Annotated[dict[Name, Stiffness], Field(max_length=50)] = Field(default_factory=dict)
    """Stiffness of servos by model, instead of the table of models."""
    couplings: Annotated[tuple[Coupling, ...], Field(max_length=16)] = ()
    """Pairs of joints that two servos turn together."""
    buses: Annotated[dict[Name, Bus], Field(min_length=1, max_length=16)]
    """Lines of servos, by name."""
    imu: Imu | None = None
    """Inertial measurement unit."""
    observers: Annotated[dict[Name, Observer], Field(max_length=200)]
    """Observers, by name."""
    ignore_pairs: Annotated[tuple[IgnorePair, ...], Field(max_length=500)]
    """Links that are never checked against each other."""
    feet: Annotated[dict[Name, Foot], Field(max_length=4)]
    """Soles by side (left, right); none if the robot does not stand."""
    postures: Postures
    """The robot's own postures."""
    landmarks: Annotated[dict[Name, Landmark], Field(max_length=50)]
    """Robot frames that follow parts of the human, by name."""
    safety: Safety
    """Bounds of operation."""
    reconstruct: Name
    """Priority file of the first stage: sensors to human posture."""
    retarget: Name
    """Priority file of the second stage: human posture to robot posture."""
    standing: Name | None = None
    """The same for a robot on its soles that can tip: a real one, in physics, or one that steps. Absent: `balanced`
    instead of `servo`, which ignores motion; else `retarget`."""

    _path: Path = PrivateAttr(default=Path())

    @property
    def path(self) -> Path:
        """The file of the profile."""
        return self._path

    @property
    def body_path(self) -> Path:
        """The body file."""
        return self._path.parent / self.body

    def servo_specs(self) -> tuple[ServoSpec, ...]:
        """The servos for the hardware side, in the profile's order. Raises HardwareError for an unknown model."""
        stiffness = {find_model(name).name: entry for name, entry in self.stiffness.items()}
        specs = servo_specs(self.servos, self.couplings)
        placed = [replace(spec, protocol=self.buses[spec.bus].protocol) for spec in specs]
        return tuple(with_stiffness(spec, stiffness.get(spec.model.name)) for spec in placed)

    def bus_specs(self) -> tuple[BusSpec, ...]:
        """The buses for the hardware side, in the profile's order. Raises HardwareError for an unknown model."""
        layouts = self.layouts()
        return tuple(bus.spec(name, layouts[name]) for name, bus in self.buses.items())

    def imu_spec(self) -> ImuSpec | None:
        """The IMU for the hardware side, if any."""
        return None if self.imu is None else self.imu.spec()

    def layouts(self) -> dict[str, Layout]:
        """The layout of the control tables by bus. Raises HardwareError for an unknown model."""
        servos = self.servos.values()
        return {
            name: bus.layout(find_model(servo.model) for servo in servos if servo.bus == name)
            for name, bus in self.buses.items()
        }


def read_profile(path_or_name: str | Path, *, check: Check[RobotProfile] | None = None) -> RobotProfile:
    """A robot's profile by name, by path of the file or of its folder; no body is read. check: cross checks. Raises
    UsageError for an unknown name, ConfigError with all problems."""
    document = read_as(Kind.ROBOT, path_or_name)
    profile = validated(RobotProfile, document, check=check)
    profile._path = document.path
    return profile


DRAFT = "# DRAFT"


def marked_lines(text: str) -> tuple[int, ...]:
    """Numbers, from 1, of the lines that still end with the mark."""
    lines = enumerate(text.splitlines(), 1)
    return tuple(number for number, line in lines if DRAFT in line and not line.lstrip().startswith("#"))
