"""Reading MJCF and URDF: what is accepted, how the root is set, and what bad files say."""

from pathlib import Path

import pytest

from bodies import TWO_LINK_URDF
from messages import Facts, refuses, shows, shows_lines
from retarget.errors import InputError
from retarget.model.body import load_body, load_body_text
from retarget.model.body_file import MAX_BYTES, MAX_LINKS, compile_body_text

FREE_MJCF = """<mujoco><worldbody><body name="base"><freejoint name="root"/><geom size="0.1" mass="2"/>
  <body name="arm" pos="0 0 1"><joint name="swing" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body></worldbody>
  <keyframe><key qpos="0 0 1 1 0 0 0 0.5"/></keyframe></mujoco>"""


def test_a_urdf_keeps_every_link_and_stays_fixed_unless_asked() -> None:
    file = compile_body_text(TWO_LINK_URDF, source="robot.urdf")
    names = [file.model.body(i).name for i in range(file.model.nbody)]
    assert names == ["world", "base", "arm", "tip"]
    assert file.root == "fixed" and file.model.nv == 1 and file.notes == ()


def test_a_free_root_is_added_where_the_file_has_none() -> None:
    body = load_body_text(TWO_LINK_URDF, source="robot.urdf", root="free")
    assert body.root == "free" and body.nv == 7 and body.joint_names[0] == "root"
    shows_lines(body.notes, "'base'")


def test_a_urdf_whose_root_link_is_the_world_gets_its_free_root_on_the_link_above() -> None:
    urdf = TWO_LINK_URDF.replace(
        '<link name="tip"/>',
        '<link name="tip"/><link name="world"/>'
        '<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>',
    )
    body = load_body_text(urdf, source="robot.urdf", root="free")
    assert body.nv == 7 and body.frame("base").body == 1


@pytest.mark.parametrize("root", ["fixed", "suspended"])
def test_a_free_root_is_removed_when_the_robot_is_bolted_down(root: str) -> None:
    body = load_body_text(FREE_MJCF, source="robot.xml", root=root)  # type: ignore[arg-type]
    assert body.root == root and body.dof_names == ("swing",)
    assert any("removed" in note for note in body.notes)


def test_as_it_is_the_free_root_stays() -> None:
    assert load_body_text(FREE_MJCF, source="robot.xml").root == "free"


def test_missing_meshes_of_a_urdf_are_left_out_with_a_note() -> None:
    shape = '<collision><geometry><mesh filename="package://absent/arm.stl"/></geometry></collision></link>'
    urdf = TWO_LINK_URDF.replace("</link><!-- arm -->", shape)
    body = load_body_text(urdf, source="robot.urdf")
    assert body.total_mass == pytest.approx(3.0) and any("mesh" in note for note in body.notes)


def test_links_without_mass_and_impossible_inertias_are_no_obstacle() -> None:
    urdf = TWO_LINK_URDF.replace('ixx="1"', 'ixx="9"').replace('type="fixed"', 'type="continuous"')
    assert load_body_text(urdf, source="robot.urdf").dof_names == ("swing", "weld_tip")


def test_loops_and_tendons_are_named_in_notes() -> None:
    extra = """<equality><joint name="coupled" joint1="swing"/></equality>
      <tendon><fixed name="cord"><joint joint="swing" coef="1"/></fixed></tendon></mujoco>"""
    notes = " ".join(load_body_text(FREE_MJCF.replace("</mujoco>", extra), source="robot.xml").notes)
    shows(notes, 1)


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("", ()),
        ("frame 1", ()),
        ("<html><body/></html>", "<html>"),
        ("<mujoco/>", ()),
        ("<mujoco><worldbody><body/></worldbody></mujoco>", ()),
        ('<mujoco><worldbody><body><joint type="screw"/></body></worldbody></mujoco>', "screw"),
        (FREE_MJCF.replace('axis="0 1 0"', 'axis="0 1 0" range="2 1" limited="true"'), "range"),
        (TWO_LINK_URDF.replace('xyz="0 0 0.5"', 'xyz="0 0 nan"'), "arm"),
        (FREE_MJCF.replace('mass="1"', 'mass="1" pos="0 0 nan"'), "arm"),
        (FREE_MJCF.replace('pos="0 0 1"', 'pos="0 nan 1"'), "arm"),
        (FREE_MJCF.replace('axis="0 1 0"', 'axis="0 1 0" pos="0 inf 0"'), "swing"),
        (FREE_MJCF.replace("<worldbody>", '<worldbody><body name="ball"><freejoint/><geom size="1"/></body>'), "ball"),
    ],
)
def test_bad_text_is_refused_with_its_reason(text: str, facts: Facts) -> None:
    with refuses(InputError, "robot.xml", facts):
        load_body_text(text, source="robot.xml")


def test_two_root_links_cannot_be_set_free() -> None:
    mjcf = "<mujoco><worldbody>" + '<body><joint/><geom size="1"/></body>' * 2 + "</worldbody></mujoco>"
    with refuses(InputError):
        load_body_text(mjcf, source="two.xml", root="free")
    with refuses(InputError):
        load_body_text(
            mjcf.replace("</body><body>", "</body><!--").replace("</body></w", "--></w"), source="one.xml", root="free"
        )


def test_bad_files_are_refused(tmp_path: Path) -> None:
    binary, empty, huge, chain = (tmp_path / f"{name}.xml" for name in ("binary", "empty", "huge", "chain"))
    chain.write_text('<robot name="a"><link name="b"/></robot>'.replace("<link", 3000 * '<link name="c"/>' + "<link"))
    binary.write_bytes(bytes(range(256)))
    empty.write_bytes(b"")
    with huge.open("wb") as stream:
        stream.truncate(MAX_BYTES + 1)
    bad: list[tuple[Path, Facts]] = [
        (binary, ()),
        (empty, 0),
        (huge, ()),
        (chain, (3001, MAX_LINKS)),
        (tmp_path, ()),
        (tmp_path / "absent.xml", ()),
    ]
    for path, facts in bad:
        with refuses(InputError, facts) as error:
            load_body(path)
        assert str(path) in str(error.value)


def test_a_file_is_read_like_its_text(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(TWO_LINK_URDF)
    assert load_body(path, root="free").dof_names == load_body_text(TWO_LINK_URDF, source="", root="free").dof_names
