"""The calibration of one specimen of a robot: ticks of its servos in known postures.

`$XDG_CONFIG_HOME/retarget/calibrations/<robot>.yaml`, written by `retarget servo home`, replaces the profile's zero
ticks.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from hardware.errors import HardwareError
from hardware.joint_map import JointMap, coupling_problems
from hardware.servo import ServoSpec, find_model
from retarget.errors import Problem
from retarget.schema.catalogue import calibration_path
from retarget.schema.files import write_atomic, write_own
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_parts import ServoId, Tick
from retarget.schema.strict_models import Integer, Name, Number, Schema, read_model, unknown_name
from retarget.schema.strict_yaml import Document, KeyPath, dump

CALIBRATION_OPTION = "calibration"
STEP = "Was it made with another robot or profile? Remove the file, or home the robot anew: retarget servo home"
Day = Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")]


class HomedServo(Schema):
    """One servo: at `tick` its joint was at `angle`, rad, in `posture`. Another id, model or homing offset makes it
    invalid."""

    id: ServoId
    model: Name
    homing_offset: Integer = 0
    posture: Name
    angle: Number
    tick: Tick
    date: Day


class ServoCalibration(Schema):
    """Homed servos by joint; other joints keep the profile's zero ticks."""

    robot: Name
    servos: Annotated[dict[Name, HomedServo], Field(min_length=1, max_length=250)]


def read_calibration(profile: RobotProfile, path: Path | None = None) -> ServoCalibration | None:
    """The user's calibration of this robot, or that at `path`, if any. Raises ConfigError if not valid, or of another
    robot."""
    path = calibration_path(profile.name) if path is None else path
    if not os.path.lexists(path):
        return None
    return read_model(ServoCalibration, path, check=lambda read, document: _problems(profile, read, document))


def calibrated(specs: Sequence[ServoSpec], calibration: ServoCalibration) -> tuple[ServoSpec, ...]:
    """The servos with calibrated zero ticks. Raises HardwareError if they do not fit."""
    homed = [calibration.servos.get(spec.joint) for spec in specs]
    positions = np.array([0.0 if servo is None else servo.angle for servo in homed])
    zeros = JointMap(specs).zeros(np.array([0 if servo is None else servo.tick for servo in homed]), positions)
    return tuple(
        spec if servo is None else replace(spec, zero_tick=int(zero))
        for spec, servo, zero in zip(specs, homed, zeros, strict=True)
    )


def write_calibration(calibration: ServoCalibration, path: Path | None = None) -> Path:
    """Write the user's file, or only `path`, and return its path. Raises UsageError."""
    comment = "Which tick each servo of this one robot reads at angle, rad. Written by: retarget servo home"
    content = dump(calibration.model_dump(exclude_defaults=True), comment=comment).encode()
    if path is not None:
        write_atomic(path, content, option=CALIBRATION_OPTION)
        return path
    path = calibration_path(calibration.robot)
    write_own(path, content, option=CALIBRATION_OPTION)
    return path


def _problems(profile: RobotProfile, read: ServoCalibration, document: Document) -> list[Problem]:
    found: list[Problem] = []
    if read.robot and read.robot != profile.name:
        allowed = profile.name
        found.append(
            document.problem(("robot",), "of another robot", found=read.robot, allowed=allowed, next_step=STEP)
        )
    for joint, servo in read.servos.items():
        here: KeyPath = ("servos", joint)
        own = profile.servos.get(joint)
        if own is None:
            found.append(unknown_name(document, here, "joint of this robot", joint, profile.servos))
            continue
        for key, theirs, ours in (
            ("id", servo.id, own.id),
            ("model", _model(servo.model), _model(own.model)),
            ("homing_offset", servo.homing_offset, own.homing_offset),
        ):
            if theirs != ours:
                what = f"another {key.replace('_', ' ')} than in the profile"
                found.append(document.problem((*here, key), what, found=str(theirs), allowed=str(ours), next_step=STEP))
    for coupling in profile.couplings:
        homed = [joint for joint in coupling.joints if joint in read.servos]
        if len(homed) == 1:
            what, allowed = "half of a coupled pair", " and ".join(coupling.joints) + ", or none of them"
            found.append(document.problem(("servos", homed[0]), what, found=homed[0], allowed=allowed, next_step=STEP))
    if found or document.problems or not read.servos:
        return found
    return [
        document.problem(("servos", joint, "tick"), f"impossible zero: {text}", next_step=STEP)
        for joint, text in impossible_zeros(profile.servo_specs(), read)
    ]


def impossible_zeros(specs: Sequence[ServoSpec], calibration: ServoCalibration) -> list[tuple[str, str]]:
    """Joints that could not reach their limits with the calibrated zero ticks, with the reasons."""
    try:
        zeroed = calibrated(specs, calibration)
    except HardwareError:
        return []  # the profile itself is at fault, and says so
    found = [(spec.joint, text) for spec in zeroed for text in spec.problems()]
    return found + [(text.split(":")[0], text) for text in coupling_problems(zeroed)]


def _model(name: str) -> str:
    """Its name in the table of models, without the connector's suffix."""
    try:
        return find_model(name).name
    except HardwareError:
        return name
