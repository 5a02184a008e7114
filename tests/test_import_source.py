"""Body files that are broken, hostile or something else: one message each, and nothing that hangs."""

import re
from pathlib import Path

import pytest

from retarget.errors import InputError
from retarget.importing.source import MAX_DEPTH, read_source
from support.messages import Facts, refuses
from unknown_robots import humanoid

LAUGHS = '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;">]><robot name="&y;"/>'
BAD: dict[str, tuple[str, Facts]] = {
    "broken": (humanoid()[:500], "XML"),
    "text": ("hello", "XML"),
    "binary": ("\x00\x01\x02", "XML"),
    "svg": ("<svg/>", ("URDF", "MJCF", "<svg>")),
    "entities": (LAUGHS, ()),
    "external": ('<!DOCTYPE a SYSTEM "http://localhost/a.dtd"><robot/>', ()),
    "deep": ("<mujoco>" + "<body>" * (MAX_DEPTH + 1), MAX_DEPTH),
    "xacro": ('<robot xmlns:xacro="x"><xacro:macro name="a"></robot>', "xacro robot.xacro"),
    "xacro without its name": ('<robot><xacro:include filename="a"/></robot>', "xacro robot.xacro"),
    "xacro that is sound XML": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
        ("<xacro:include>", "xacro robot.xacro"),
    ),
    "itself": ('<mujoco><include file="body.xml"/></mujoco>', ()),
    "absent": ('<mujoco><include file="other.xml"/></mujoco>', "other.xml"),
    "device": ('<mujoco><include file="/dev/zero"/></mujoco>', "/dev/zero"),
    "empty": ("", 0),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused(case: str, tmp_path: Path) -> None:
    path = tmp_path / "body.xml"
    path.write_text(BAD[case][0], encoding="utf-8")
    with refuses(InputError, BAD[case][1]) as caught:
        read_source(path)
    assert len(caught.value.problems) == 1


def test_a_urdf_that_xacro_made_keeps_the_name_of_xacro(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"/>')
    assert read_source(path).name == "a"


def test_entities_are_found_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_bytes(('<?xml version="1.0" encoding="utf-16"?>' + LAUGHS).encode("utf-16"))
    with refuses(InputError):
        read_source(path)


@pytest.mark.parametrize("name", ["nosuch.urdf", ".", "/dev/zero", "a" * 5000, "a\0b"])
def test_what_is_no_file(name: str, tmp_path: Path) -> None:
    with refuses(InputError, varies=re.compile("a{9,}")):
        read_source(tmp_path / name if name != "/dev/zero" else Path(name))


def test_includes_that_include(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text('<mujoco><include file="b.xml"/></mujoco>')
    (tmp_path / "b.xml").write_text(f"<mujoco><worldbody><body/></worldbody>{'<!-- -->' * 3}</mujoco>")
    assert read_source(tmp_path / "a.xml").included
    (tmp_path / "b.xml").write_text(LAUGHS)
    with refuses(InputError, where="b.xml:1"):
        read_source(tmp_path / "a.xml")


def test_kind_and_name_are_by_content(tmp_path: Path) -> None:
    path = tmp_path / "thing.xml"
    path.write_text(humanoid())
    source = read_source(path)
    assert (source.kind, source.name, source.included) == ("urdf", "stranger", False)
    path.write_text("<mujoco/>")
    source = read_source(path)
    assert (source.kind, source.name) == ("mjcf", "thing")
