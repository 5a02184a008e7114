"""The size of a performer as a file: what is written is read, the one before stays, and nonsense is refused."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import Facts, refuses, shows
from people import at_rest
from retarget.errors import ConfigError, UsageError
from retarget.human.performer_calibration import check_person_place, person_of, person_path, read_person, write_person
from retarget.human.rest_pose import fit_rest_pose
from retarget.model.human_dimensions import proportional_dimensions

FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's configuration folder, empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "retarget" / "people"


def written(stature: float = 1.8, *, name: str = "anna", date: str = "2026-01-31") -> Path:
    size = replace(proportional_dimensions(stature), mass=64.0)
    return write_person(person_of(name, size, sensors=FIVE, date=date))


def test_what_is_written_is_read(own: Path) -> None:
    assert read_person("anna") is None
    standing = at_rest(proportional_dimensions(1.68), 0.2)
    places = np.array([standing[name] for name in FIVE])
    size = replace(fit_rest_pose(FIVE, places, source="vmc://:1").dimensions, mass=61.5)
    person = person_of("anna", size, sensors=FIVE, date="2026-01-31")
    assert write_person(person) == own / "anna.yaml" == person_path("anna")
    read = read_person("anna")
    assert read == person
    np.testing.assert_allclose(read.dimensions.offset, size.offset, atol=5.1e-5)
    assert (read.dimensions.stature, read.dimensions.mass) == (round(size.stature, 4), 61.5)
    shows(read.dimensions.origin, "anna", "2026-01-31")
    assert sorted(path.name for path in own.iterdir()) == ["anna.yaml"]


@settings(max_examples=40)
@given(stature=st.floats(0.6, 2.5), mass=st.floats(2.5, 390.0), name=st.from_regex(r"[\w-]{1,40}", fullmatch=True))
def test_every_human_survives_the_file(stature: float, mass: float, name: str) -> None:
    person = person_of(name, replace(proportional_dimensions(stature), mass=mass), sensors=FIVE, date="2026-12-31")
    write_person(person)
    assert read_person(name) == person


def test_a_place_that_cannot_be_written_is_refused_before_anybody_stands_still(own: Path) -> None:
    check_person_place("anna")
    own.parent.mkdir(parents=True)
    own.write_text("")
    with refuses(UsageError):
        check_person_place("anna")


@pytest.mark.parametrize(
    ("line", "instead", "message"),
    [
        ("layout: 2", "layout: 1", ("yaml:2", 2, 1)),
        ("layout: 2", "", ()),
        ("stature: 1.8", "stature: 3.1", ("3.1", "0.5", "2.6")),
        ("stature: 1.8", "stature: 1,8", ()),
        ("stature: 1.8", "stature: .nan", ()),
        ("mass: 64.0", "mass: 640.0", ()),
        (r"  l_knee: .*", "  l_knee: [0.0, 0.0, -1.2]", ()),
        (r"  l_knee: .*", "  l_knee: [0.0, 0.0, 0.44]", ()),
        (r"  l_hip: (.*)", r"  l_hip: [0.0, -0.09, -0.08]", ()),
        (r"  spine: .*", "  spine: [0.0, 0.0, 5.0]", ()),
        (r"  spine: .*\n", "", ()),
        (r"  spine: ", "  spines: ", ()),
        (r"  spine: .*", "  spine: [0.0, 0.1]", "offsets.spine"),
        (r"sensors:", "sensor:", ()),
        (r"date: .*", 'date: "today"', "date"),
    ],
)
def test_nonsense_is_refused(line: str, instead: str, message: Facts) -> None:
    path = written()
    changed, count = re.subn(line, instead, path.read_text(), count=1)
    assert count == 1
    path.write_text(changed)
    with refuses(ConfigError, message):
        read_person("anna")
