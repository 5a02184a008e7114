"""The file of a measured performer: `$XDG_CONFIG_HOME/retarget/people/<name>.yaml`."""

import os
import re
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from retarget.arithmetic import norm
from retarget.errors import ConfigError, InputError, Problem, UsageError
from retarget.frames import SENSORS
from retarget.human.rest_pose import MAX_LOOSE_M
from retarget.model.human_dimensions import POINTS, STATURE_M, HumanDimensions, check_plausible, proportional_dimensions
from retarget.schema.catalogue import user_folder
from retarget.schema.files import check_folder, write_own
from retarget.schema.strict_models import Integer, Name, Positive, Schema, Text, Vector3, read_model, unknown_name
from retarget.schema.strict_yaml import Document, KeyPath, dump, read_text, scan
from retarget.types import FloatArray

OPTION = "--person"
LAYOUT = 2
"""Layout of the file. Another one is refused, as its numbers mean other things."""
STEP = "Measure anew with --recalibrate"
MASS_KG = (2.0, 400.0)  # a mass beyond is mistyped
FARTHEST = (3.0, 0.1)  # a point may be this many times as far from its parent as usual, and this many m more
_NAME = re.compile(r"[\w-]{1,40}")
# Points whose offsets go straight down from their parents.
_HANGING = tuple(f"{side}_{part}" for part in ("elbow", "wrist", "hand", "knee", "ankle") for side in "lr")
Day = Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")]


class Person(Schema):
    """A measured person. stature: m; mass: kg; origin: of the measurement; sensors: that took part.

    offsets: each of `human_dimensions.POINTS` from its parent, m, standing, arms hanging, x forward, y left, z up.
    sensor_offsets: by convention of roles and sensor, from the joint to the sensor, m, in its canonical axes, in
    addition to the convention's.
    """

    layout: Integer
    name: Name
    date: Day
    stature: Positive
    mass: Positive
    origin: Text
    sensors: Annotated[tuple[Name, ...], Field(max_length=64)]
    offsets: Annotated[dict[Name, Vector3], Field(max_length=64)]
    sensor_offsets: Annotated[dict[Name, dict[Name, Vector3]], Field(default_factory=dict, max_length=16)]

    @property
    def dimensions(self) -> HumanDimensions:
        """The person's size."""
        offset = np.array([self.offsets[name] for name in POINTS])
        return HumanDimensions(offset, self.stature, self.mass, f"{self.name}, measured on {self.date}: {self.origin}")

    def offset(self, convention: str, sensors: tuple[str, ...]) -> FloatArray:
        """Offsets (k, 3) m of these sensors, zero where unknown."""
        known = self.sensor_offsets.get(convention, {})
        return np.array([known.get(sensor, (0.0, 0.0, 0.0)) for sensor in sensors])


def person_of(
    name: str,
    dimensions: HumanDimensions,
    *,
    sensors: tuple[str, ...],
    date: str,
    convention: str = "",
    offset: FloatArray | None = None,
) -> Person:
    """Make a person from a measurement, to a tenth of a millimetre. offset (k, 3) m: see `Person.offset`."""
    offsets = {point: _rounded(at) for point, at in zip(POINTS, dimensions.offset, strict=True)}
    rows = {} if offset is None else dict(zip(sensors, offset, strict=True))
    known = {sensor: _rounded(by) for sensor, by in rows.items() if by.any()}
    return Person(
        layout=LAYOUT,
        name=name,
        date=date,
        stature=round(dimensions.stature, 4),
        mass=round(dimensions.mass, 2),
        origin=dimensions.origin,
        sensors=sensors,
        offsets=offsets,
        sensor_offsets={convention: known} if known else {},
    )


def _rounded(at: FloatArray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in at)
    return x, y, z


def person_path(name: str) -> Path:
    """Path of a person's file, which need not exist. Raises UsageError for an invalid name."""
    if not _NAME.fullmatch(name):
        raise UsageError(
            "this is no name of a performer",
            where=OPTION,
            found=repr(name[:80]),
            allowed="1 to 40 letters, digits, - and _",
        )
    return user_folder() / "people" / f"{name}.yaml"


def check_person_place(name: str) -> None:
    """Raise UsageError if the person's file cannot be written. Leaves nothing behind."""
    check_folder(person_path(name).parent, option=OPTION)


def read_person(name: str) -> Person | None:
    """Read a person, None if there is no file. Raises UsageError, or ConfigError: not valid, or no human."""
    path = person_path(name)
    if not os.path.lexists(path):
        return None
    document = scan(read_text(path), path)
    layout = document.data.get("layout")
    if layout != LAYOUT or isinstance(layout, bool):  # one error, not one for every key that has changed
        what, found = "a person's file of another layout", "none" if layout is None else repr(layout)[:60]
        problem = document.problem(("layout",), what, found=found, allowed=str(LAYOUT), next_step=STEP)
        raise ConfigError.from_problems([problem])
    person = read_model(Person, path, check=_problems)
    return person


def write_person(person: Person) -> Path:
    """Write the person's file atomically and keep the one before as `.previous.yaml`. Returns its path.

    Raises UsageError with the system's reason.
    """
    path = person_path(person.name)
    comment = "The size of one performer, m and kg: x forward, y left, z up. Written by: retarget run --person NAME"
    write_own(path, dump(person.model_dump(exclude_defaults=True), comment=comment).encode(), option=OPTION)
    return path


def _problems(read: Person, document: Document) -> list[Problem]:
    problems = [
        unknown_name(document, ("offsets", name), "point", name, POINTS) for name in read.offsets if name not in POINTS
    ]
    missing = [name for name in POINTS if name not in read.offsets]
    if missing:
        problems.append(
            document.problem(("offsets",), "points missing", found=f"no {', '.join(missing[:5])}", next_step=STEP)
        )
    for convention, offsets in (read.sensor_offsets or {}).items():
        for sensor, by in offsets.items():
            here: KeyPath = ("sensor_offsets", convention, sensor)
            if sensor not in SENSORS:
                problems.append(unknown_name(document, here, "sensor", sensor, SENSORS))
            elif norm(np.array(by)) > MAX_LOOSE_M + 1e-3:
                what, allowed = "a sensor too far from its joint", f"at most {MAX_LOOSE_M:g} m"
                problems.append(document.problem(here, what, found=str(list(by)), allowed=allowed, next_step=STEP))
    if read.stature is not None and read.mass is not None and not (problems or document.problems or missing):
        problems += _inhuman(read, document)
    return problems


def _inhuman(read: Person, document: Document) -> list[Problem]:
    found: list[Problem] = []
    for key, value, (low, high) in (("stature", read.stature, STATURE_M), ("mass", read.mass, MASS_KG)):
        if not low <= value <= high:
            what, allowed = f"no human's {key}", f"{low:g} to {high:g}"
            found.append(document.problem((key,), what, found=f"{value:g}", allowed=allowed, next_step=STEP))
    if found:
        return found
    usual, dimensions = proportional_dimensions(read.stature), read.dimensions
    try:
        check_plausible(dimensions, source=str(document.path))
    except InputError as error:
        found += [document.problem((), one.what, found=one.found, allowed=one.allowed) for one in error.problems]
    for name in POINTS:
        offset = dimensions.of(name)
        most = FARTHEST[0] * usual.length(name) + FARTHEST[1]
        what = ""
        if norm(offset) > most:
            what = f"too far from its parent for a human of this stature: {most:.2f} m at most"
        elif name in _HANGING and not (offset[2] < 0.0 and norm(offset[:2]) < 1e-3):
            what = "a limb that does not hang straight down"
        elif name[2:] in ("hip", "shoulder") and offset[1] * usual.of(name)[1] <= 0.0:
            what = "on the wrong side of the body"
        if what:
            shown = str([round(float(x), 3) for x in offset])
            found.append(document.problem(("offsets", name), what, found=shown, next_step=STEP))
    return found
