"""The body beside a drafted profile, from files that are sound, incomplete, broken or hostile: one message each."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path

import hypothesis
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import Facts, refuses, shows
from retarget.errors import InputError
from retarget.model.body import load_body, load_body_text
from retarget.model.body_xml import MAX_DEPTH
from retarget.model.meshes import link_meshes
from retarget.setup.body_draft import BodyDraft, draft_body, facing_x
from retarget.setup.robot_file import MeshFiles, read_source
from unknown_robots import HUMANOID, Part, humanoid, urdf


def drafted(text: str, folder: Path, *, no_meshes: bool = False) -> BodyDraft:
    path = folder / ("body.urdf" if text.startswith("<robot") else "body.xml")
    path.write_text(text, encoding="utf-8")
    return draft_body(read_source(path), no_meshes=no_meshes)


LAUGHS = '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;">]><robot name="&y;"/>'
BAD: dict[str, tuple[str, Facts]] = {
    "broken": (humanoid()[:500], "XML"),
    "text": ("hello", "XML"),
    "binary": ("\x00\x01\x02", "XML"),
    "svg": ("<svg/>", ("URDF", "MJCF", "<svg>")),
    "entities": (LAUGHS, ()),
    "utf-16": ('<?xml version="1.0" encoding="utf-16"?>' + LAUGHS, ()),
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
    "links": ("<robot>" + 3000 * '<link name="a"/>' + "</robot>", 3000),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused(case: str, tmp_path: Path) -> None:
    path = tmp_path / "body.xml"
    path.write_text(BAD[case][0], encoding="utf-16" if case == "utf-16" else "utf-8")
    with refuses(InputError, BAD[case][1]) as caught:
        read_source(path)
    assert len(caught.value.problems) == 1


def test_kind_and_name_are_by_content(tmp_path: Path) -> None:
    path = tmp_path / "thing.xml"
    path.write_text(humanoid())
    source = read_source(path)
    assert (source.kind, source.name) == ("urdf", "stranger")
    path.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"/>')  # made by xacro
    assert read_source(path).name == "a"
    path.write_text("<mujoco/>")
    source = read_source(path)
    assert (source.kind, source.name) == ("mjcf", "thing")


TETRAHEDRON = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


def binary_stl() -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[list(face)].ravel(), 0) for face in FACES]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


@pytest.mark.parametrize("name", ["", ".", "..", "package://", "/", "a\0b.stl", "m.stl/", "x" * 5000 + ".stl"])
def test_names_of_nothing(name: str, tmp_path: Path) -> None:
    assert MeshFiles(tmp_path / "body.urdf").find(name) is None


FOOT = '<box size="0.07 0.14 0.02"/>'


def finger(**changes: str) -> Part:
    return Part("finger", "q9", (0, 0.1, 0), (0, 0, 1), (0, 1), (0.01, 0.03, 0.01), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["mimic", "planar", "floating", "prismatic"])
def test_joints_that_no_servo_drives(kind: str, tmp_path: Path) -> None:
    part = finger(extra='<mimic joint="j_q8"/>') if kind == "mimic" else finger(kind=kind)
    text = humanoid([*HUMANOID, part])
    body = drafted(text, tmp_path)
    assert body.model.njnt == len(HUMANOID) and body.model.body("finger").id > 0
    assert body.notes == (f"{kind} joints, which no servo drives, made rigid: j_finger",)


def test_all_problems_are_reported_at_once(tmp_path: Path) -> None:
    text = re.sub("<inertial>.*?</inertial>", "", humanoid([*HUMANOID, finger(kind="rubber")]))
    with refuses(InputError, 2):
        drafted(text, tmp_path)


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        (r"<inertia [^>]*/>", "", ("<inertia>", "chest")),
        (r'ixx="[^"]*"', 'ixx="heavy"', ("<inertia>", "chest")),
        (r'<mass value="[^"]*"', '<mass value="nan"', ("<mass>", 0, "chest")),
        (r'<mass value="[^"]*"', '<mass value="-1"', ("<mass>", 0, "chest")),
        (r"<mass [^>]*/>", "", ("<mass>", 0, "chest")),
    ],
)
def test_an_invalid_inertia_is_reported_with_its_link(wrong: str, right: str, message: Facts, tmp_path: Path) -> None:
    """Not in the words of a parser, which knows no links."""
    with refuses(InputError, message):
        drafted(re.sub(wrong, right, humanoid(), count=1), tmp_path)


def test_meshes_that_are_missing(tmp_path: Path) -> None:
    mjcf = two(asset='<mesh name="m" file="gone.stl"/>', geom='<geom type="mesh" mesh="m"/>' + BALL)
    with refuses(InputError, "gone.stl", "--no-meshes"):
        drafted(mjcf, tmp_path)
    body = drafted(mjcf, tmp_path, no_meshes=True)
    assert body.model.nmesh == 0 and "gone.stl" in body.notes[0]
    text = humanoid().replace(FOOT, '<mesh filename="package://r/meshes/foot.stl"/>')
    with refuses(InputError, "package://r/meshes/foot.stl", "--no-meshes"):
        drafted(text, tmp_path)
    body = drafted(text, tmp_path, no_meshes=True)
    shows(body.notes[0], "package://r/meshes/foot.stl")
    assert body.model.ngeom == len(HUMANOID) + 1 - 2


def text_stl() -> bytes:
    facets = ["".join(f"vertex {x:g} {y:e} {z}\n" for x, y, z in TETRAHEDRON[list(face)]) for face in FACES]
    text = "".join(f"facet normal 0 0 0\nouter loop\n{facet}endloop\nendfacet\n" for facet in facets)
    return f"solid foot\n{text}endsolid foot\n".encode()


@pytest.mark.parametrize("content", [binary_stl(), text_stl()], ids=["binary", "text"])
@given(
    name=st.sampled_from(
        [
            *(f"{prefix}foot.stl" for prefix in ("", "meshes/", "../meshes/", "package://r/meshes/")),
            *(f"{prefix}foot.stl" for prefix in ("model://r/meshes/", "$(find r)/meshes/")),
            "file:///abroad/ws/src/r/meshes/foot.stl",
            "C:\\ws\\r\\meshes\\foot.stl",
        ]
    ),
    upper=st.booleans(),
    folder=st.sampled_from(["r/urdf/meshes", "r/meshes", "r/urdf/deep/meshes", "R/Meshes"]),
)
def test_meshes_are_found_whatever_the_case_and_path_of_their_names(
    content: bytes, name: str, folder: str, *, upper: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Below the URDF by its last parts, or in its package; relative paths and packages only where they say."""
    top = tmp_path_factory.mktemp("ws")
    urdf = top / ("R" if folder[0] == "R" else "r") / "urdf" / "body.urdf"
    place = top / folder / ("FOOT.STL" if upper else "foot.stl")
    for one in (urdf, place):
        one.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(content)
    found = MeshFiles(urdf).find(name)
    in_package = "urdf" not in folder
    by_package = name.startswith(("package", "model", "$")) and folder[0] == "r"
    if (not in_package and not name.startswith("..")) or (in_package and (by_package or name.startswith(".."))):
        assert found is not None and found.resolve() == place
    else:
        assert found is None or found.resolve() == place


@pytest.mark.parametrize("content", [binary_stl(), text_stl()], ids=["binary", "text"])
def test_meshes_become_simple_shapes(content: bytes, tmp_path: Path) -> None:
    """What is written needs no other file, and has the mesh for pictures alone."""
    (tmp_path / "foot.stl").write_bytes(content)
    body = drafted(humanoid().replace(FOOT, '<mesh filename="FOOT.stl"/>'), tmp_path)
    plain = drafted(humanoid(), tmp_path)
    assert b"file=" not in body.content and b"foot.stl" not in body.content
    assert body.model.nmesh == 1 and body.model.body_mass == pytest.approx(plain.model.body_mass)
    assert body.notes == ("meshes of 2 links are capsules and boxes around them; pictures keep them, coarser",)
    written = load_body_text(body.content.decode(), source="test")
    looks = [geom for geom in written.geoms if geom.kind == "mesh"]
    assert len(looks) == 2 and not any(geom.collides for geom in looks)
    assert written.mass == pytest.approx(plain.model.body_mass)
    simple = {geom.body: geom.kind for geom in written.geoms if geom.collides}
    assert all(simple[geom.body] in ("box", "capsule") for geom in looks), "what collides is simple"
    drawn, shell = link_meshes(written)[looks[0].body, None], looks[0].triangles
    assert shell is not None and len(drawn.faces) >= len(shell)
    assert np.ptp(drawn.vertices, axis=0).max() < 1.5 * np.ptp(shell.reshape(-1, 3), axis=0).max()
    assert not body.too_large


RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
LOOK = '<geom contype="0" conaffinity="0" mass="0" {}/>'
COLOURED = f"""<mujoco><asset><mesh name="shoe" file="shoe.obj"/><material name="green" rgba="0 1 0 1"/></asset>
<worldbody><body name="base"><freejoint/><geom size=".1"/><body name="arm" pos="0 .3 0"><joint range="-60 60"/>
<geom type="mesh" mesh="shoe"/>{LOOK.format('type="mesh" mesh="shoe" rgba="1 0 0 1"')}
{LOOK.format('type="mesh" mesh="shoe" material="green"')}{LOOK.format('size=".04" rgba="0 0 1 1"')}
</body></body></worldbody></mujoco>"""
PAINTED = '<visual><geometry>{}</geometry><material name="{}"><color rgba="{} 1"/></material></visual>'
COLOURED_URDF = "".join(
    PAINTED.format(*one)
    for one in (
        ('<mesh filename="shoe.obj"/>', "red", "1 0 0"),
        ('<mesh filename="shoe.obj"/>', "green", "0 1 0"),
        ('<sphere radius="0.04"/>', "blue", "0 0 1"),
    )
)


@pytest.mark.parametrize("kind", ["MJCF", "URDF"])
def test_what_is_seen_keeps_its_colours_and_simple_shapes(kind: str, tmp_path: Path) -> None:
    (tmp_path / "shoe.obj").write_text(SHOE, encoding="utf-8")
    text, link = COLOURED, "arm"
    if kind == "URDF":
        text, link = humanoid().replace("</link>", f"{COLOURED_URDF}</link>"), "chest"
    body = drafted(text, tmp_path)
    written = load_body_text(body.content.decode(), source="test")
    number = written.body_names.index(link)
    geoms = [geom for geom in written.geoms if geom.body == number]
    assert [geom.kind for geom in geoms if geom.collides] == ["box"]
    seen = {(geom.kind, geom.colour) for geom in geoms if not geom.collides}
    assert seen == {("mesh", RED), ("mesh", GREEN), ("sphere", BLUE)}
    assert {colour for owner, colour in link_meshes(written) if owner == number} == {RED, GREEN, BLUE}
    assert written.mass == pytest.approx(body.model.body_mass)


SEEN = '<visual><geometry><mesh filename="{}"/></geometry></visual></link>'
"""What is seen of a link beside what it collides with."""


@pytest.mark.parametrize("meshed", [True, False], ids=["a mesh collides", "a box collides"])
def test_what_is_seen_of_a_link_stays_for_pictures_alone(*, meshed: bool, tmp_path: Path) -> None:
    """The shapes that collide, observers are fitted to, and weigh are those of the same file without it."""
    (tmp_path / "foot.stl").write_bytes(binary_stl())
    (tmp_path / "shoe.obj").write_text(SHOE, encoding="utf-8")
    text = humanoid().replace(FOOT, '<mesh filename="foot.stl"/>') if meshed else humanoid()
    plain, body = drafted(text, tmp_path), drafted(text.replace("</link>", SEEN.format("shoe.obj")), tmp_path)
    for one, other in zip(plain.shapes, body.shapes, strict=True):
        assert (one.link_name, one.kind, one.around_mesh) == (other.link_name, other.kind, other.around_mesh)
        np.testing.assert_array_equal([*one.size, *one.pos, *one.quat], [*other.size, *other.pos, *other.quat])
    before, after = (load_body_text(draft.content.decode(), source="test") for draft in (plain, body))
    np.testing.assert_array_equal(before.mass, after.mass)
    collide = [[(g.body, g.kind, g.size.tolist()) for g in one.geoms if g.collides] for one in (before, after)]
    assert collide[0] == collide[1]
    drawn = link_meshes(after)
    assert set(drawn) == {(link, None) for link in range(1, len(after.parent))}
    for mesh in drawn.values():
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (0.08, 0.06, 0.3), atol=2e-3)
    assert any("visual" in note for note in body.notes)


def test_what_is_seen_refuses_no_body(tmp_path: Path) -> None:
    """A picture that MuJoCo cannot read is left out with a note; one that is not there, without a word."""
    (tmp_path / "shoe.obj").write_bytes(b"v 0 0 0\nf 1 2")
    (tmp_path / "cut.stl").write_bytes(binary_stl()[:100])
    plain = drafted(humanoid(), tmp_path)
    for name, noted in (("shoe.obj", True), ("cut.stl", True), ("gone.dae", False)):
        body = drafted(humanoid().replace("</link>", SEEN.format(name), 1), tmp_path)
        assert body.content == plain.content and any("visual" in note for note in body.notes) == noted


SHOE = """v -.04 -.03 0\nv .04 -.03 0\nv .04 .03 0\nv -.04 .03 0\nv 0 0 .3
f 1 3 2\nf 1 4 3\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5
"""
"""A pyramid, OBJ."""


@pytest.mark.parametrize(
    "content",
    [b"solid\nnothing", b"\0" * 84, binary_stl()[:-60], text_stl()[: text_stl().index(b"endfacet") + 9]],
    ids=["text", "empty", "cut", "cut text"],
)
def test_a_damaged_mesh_is_named_as_the_user_knows_it(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "foot.stl").write_bytes(content)
    with refuses(InputError, "foot.stl") as caught:
        drafted(humanoid().replace(FOOT, '<mesh filename="foot.stl"/>'), tmp_path)
    assert "mesh_0" not in str(caught.value)


@given(scale=st.sampled_from([0.001, 1.0, 25.4, 100.0, 1000.0]))
def test_meshes_in_another_unit_are_noted(scale: float, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A foot of 0.3 m in cm, inches or mm; the joints are within 0.6 m."""
    folder = tmp_path_factory.mktemp("unit")
    (folder / "foot.stl").write_bytes(binary_stl())
    mesh = f'<mesh filename="foot.stl" scale="{scale} {scale} {scale}"/>'
    body = drafted(humanoid().replace(FOOT, mesh), folder)
    assert bool(body.too_large) == (scale > 10.0)
    assert "foot.stl" in body.too_large or scale < 10.0


def test_visual_shapes_stand_in_where_no_others_are(tmp_path: Path) -> None:
    plain, shown = drafted(humanoid(), tmp_path), humanoid().replace("collision>", "visual>")
    body = drafted(shown, tmp_path)
    assert body.content == plain.content and not body.notes
    bare = re.sub("<visual>.*?</visual>", "", shown)
    with refuses(InputError, "no shapes", "visual"):
        drafted(bare, tmp_path)


Ranges = Sequence[tuple[float, float] | None]
LIMITED = ("urdf", "xml", "radian xml")
"""Files of joints with limits: URDF, MJCF in degrees, which it has without a word, and in rad."""


def chain(ranges: Ranges, form: str) -> str:
    """A chain of joints `j 0`, `j 1`, ... with limits in rad; None: without limits."""
    if form == "urdf":
        parts = [
            Part(f"p{n}", f"p{n - 1}" if n else "base", (0, 0, 0.1), (0, 1, 0), both or (0, 0), (0.02, 0.02, 0.08))
            for n, both in enumerate(ranges)
        ]
        text = urdf(parts, base="base", size=(0.1, 0.1, 0.1), speed=0.3)
        return re.sub(
            'name="j_p', 'name="j ', re.sub('(revolute"(?:(?!</joint).)*)<limit lower="0" upper="0"', r"\1<limit", text)
        )
    unit = 1.0 if form == "radian xml" else 180.0 / np.pi
    begun = ""
    for n, both in enumerate(ranges):
        limits = f'range="{both[0] * unit!r} {both[1] * unit!r}"' if both else ""
        begun += f'<body name="p{n}" pos="0 0 0.1"><joint name="j {n}" axis="0 1 0" {limits}/><geom size="0.02"/>'
    compiler = '<compiler angle="radian"/>' if form == "radian xml" else ""
    return f"<mujoco>{compiler}<worldbody>{begun}{'</body>' * len(ranges)}</worldbody></mujoco>"


def drafted_chain(ranges: Ranges, form: str, folder: Path) -> tuple[BodyDraft, dict[str, tuple[float, float]]]:
    """The body, and the range of each of its joints."""
    body = drafted(chain(ranges, form), folder)
    model = body.model
    return body, {model.joint(n).name: tuple(model.jnt_range[n]) for n in range(model.njnt) if model.jnt_limited[n]}


@given(
    low=st.floats(-3.0, 3.0).map(lambda value: round(value, 3)),
    width=st.sampled_from([0.0, 0.3, 2.5]),
    swapped=st.booleans(),
    wrong=st.integers(1, 3),
    form=st.sampled_from(LIMITED),
)
@settings(max_examples=25)
def test_limits_that_are_swapped_or_equal(
    low: float, width: float, wrong: int, form: str, *, swapped: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Of some or all of three joints. They become no wider, and notes have the names of the profile."""
    folder, both = tmp_path_factory.mktemp("limits"), (low, low + width)
    hypothesis.assume(any(both))
    ranges: Ranges = [both[::-1] if swapped else both] * wrong + [(-0.5, 0.5)] * (3 - wrong)
    if width == 0.0 and wrong == 3:
        with refuses(InputError, "range"):
            drafted_chain(ranges, form, folder)
        return
    body, found = drafted_chain(ranges, form, folder)
    names = {f"j_{n}" for n in range(wrong)}
    expected = {f"j_{n}": both if f"j_{n}" in names else (-0.5, 0.5) for n in range(3)}
    if width == 0.0:
        expected = {name: one for name, one in expected.items() if name not in names}
    assert body.model.njnt == len(expected) and found == {name: pytest.approx(one) for name, one in expected.items()}
    assert set(body.limits) == (names if swapped and width else set())
    assert len(body.notes) == 1 + (swapped or width == 0.0)  # the names are no names of a profile
    assert body.speeds == ({f"j_{n}": 0.3 for n in range(3)} if form == "urdf" else {})


@pytest.mark.parametrize("form", ["urdf", "radian xml"])
@pytest.mark.parametrize(
    ("degrees", "allowed"),
    [([90, 5, 120, 4], True), ([90, 5, 4, 3], False), ([90, 120, 1.5, None], True), ([7, 6, None, None], True)],
)
def test_limits_in_degrees(degrees: list[float | None], form: str, *, allowed: bool, tmp_path: Path) -> None:
    """Where at least half are beyond a turn in rad, all are degrees; where fewer are, it is not clear."""
    ranges: Ranges = [None if one is None else (-one, one) for one in degrees]
    if not allowed:
        with refuses(InputError, "j_0", "rad"):
            drafted_chain(ranges, form, tmp_path)
        return
    _, found = drafted_chain(ranges, form, tmp_path)
    wanted = {f"j_{n}": np.radians(one) for n, one in enumerate(degrees) if one is not None}
    assert {name: both[1] for name, both in found.items()} == pytest.approx(wanted)


@pytest.mark.parametrize("limits", [None, (-1.0, 1.0), (1.0, -1.0), (np.nan, 1.0)])
def test_a_continuous_joint_keeps_limits_that_it_states(limits: tuple[float, float] | None, tmp_path: Path) -> None:
    text = chain([limits, (-0.5, 0.5)], "urdf").replace("revolute", "continuous", 1)
    if limits is not None and np.isnan(limits[0]):
        with refuses(InputError, "j 0", "numbers"):
            drafted(text, tmp_path)
        return
    body = drafted(text, tmp_path)
    assert body.model.njnt == 2 and body.model.jnt_limited[0] == (limits == (-1.0, 1.0))
    assert len(body.notes) == 1 + (limits == (-1.0, 1.0))


def test_no_warning_of_mujoco_is_printed_and_none_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    drafted(humanoid(), tmp_path)
    model = mujoco.MjModel.from_xml_string(two())
    data = mujoco.MjData(model)
    data.qacc[:] = data.qvel[:] = np.inf
    mujoco.mj_step(model, data)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists() and capfd.readouterr() == ("", "")


@pytest.mark.parametrize("first", [True, False], ids=["before the other shape", "after it"])
@pytest.mark.parametrize("seen", [True, False])
def test_a_collision_mesh_that_is_missing_beside_another_shape(*, first: bool, seen: bool, tmp_path: Path) -> None:
    """What is seen of the link stands for it, and else it is missing; other pictures go without a word."""
    mesh = '<collision><geometry><mesh filename="gone/foot.stl"/></geometry></collision>'
    shape = re.search(r"<collision>(?:(?!</collision>).)*" + re.escape(FOOT) + ".*?</collision>", humanoid(), re.DOTALL)
    assert shape is not None
    picture = shape[0].replace("collision", "visual") if seen else ""
    text = humanoid().replace(shape[0], (mesh + shape[0] if first else shape[0] + mesh) + picture, 1)
    if not seen:
        text = text.replace("</link>", SEEN.format("nice.dae"))
        with refuses(InputError, "gone/foot.stl", "--no-meshes"):
            drafted(text, tmp_path)
    body = drafted(text, tmp_path, no_meshes=not seen)
    shows(body.notes[0], "gone/foot.stl")
    assert body.model.ngeom == len(HUMANOID) + 1 + seen


def test_speeds_that_are_stated(tmp_path: Path) -> None:
    text = humanoid().replace('velocity="5.0"', 'velocity="fast"', 1).replace('velocity="5.0"', 'velocity="0"', 1)
    speeds = drafted(text, tmp_path).speeds
    assert len(speeds) == len(HUMANOID) - 2 and set(speeds.values()) == {5.0}


TWO = """<mujoco><asset>{asset}</asset><worldbody><geom type="plane" size="1 1 1"/><light pos="0 0 1"/>
  <body name="base link"><geom size="0.05"/>
  <body pos="0 0 0.1"><joint axis="0 1 0" range="-90 90"/>{geom}
  <body name="last" pos="0 0 0.1"><joint name="j/2" axis="0 1 0" {kind}/><geom type="capsule" size="0.02 0.05"/>
  </body></body></body></worldbody>{more}</mujoco>"""
BALL = '<geom size="0.02"/>'


def two(*, asset: str = "", geom: str = BALL, kind: str = "", more: str = "") -> str:
    return TWO.format(asset=asset, geom=geom, kind=kind, more=more)


def alike(first: mujoco.MjModel, second: mujoco.MjModel) -> None:
    """The same masses, and the same places in a posture."""
    assert second.body_mass == pytest.approx(first.body_mass) and second.nq == first.nq
    data = [mujoco.MjData(first), mujoco.MjData(second)]
    for model, state in zip((first, second), data, strict=True):
        state.qpos[:] = model.qpos0 + 0.3 * np.sin(np.arange(model.nq))
        mujoco.mj_forward(model, state)
    assert data[1].xpos == pytest.approx(data[0].xpos, abs=1e-5)
    assert data[1].subtree_com == pytest.approx(data[0].subtree_com, abs=1e-5)


def test_names_that_no_profile_can_hold(tmp_path: Path) -> None:
    body = drafted(two(), tmp_path)
    written = mujoco.MjModel.from_xml_string(body.content.decode())
    assert [written.body(i).name for i in range(1, 4)] == ["base_link", "link_2", "last"]
    assert [written.joint(i).name for i in range(2)] == ["joint_1", "j_2"]
    shows(body.notes[0], "'base link'", "base_link")
    assert written.nlight == 0 and b"plane" not in body.content
    alike(body.model, written)


def test_a_mesh_becomes_a_shape(tmp_path: Path) -> None:
    points = "0 0 0  0.1 0 0  0 0.1 0  0 0 0.1  0.1 0.1 0.1"
    body = drafted(two(asset=f'<mesh name="m" vertex="{points}"/>', geom='<geom type="mesh" mesh="m"/>'), tmp_path)
    written = mujoco.MjModel.from_xml_string(body.content.decode())
    assert body.model.nmesh == 1 and written.nmesh == 1 and written.ngeom == 4
    assert np.count_nonzero(written.geom_contype | written.geom_conaffinity) == 3, "the mesh is for pictures alone"
    alike(body.model, written)


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ('type="slide"', ""),
        ('type="ball"', ""),
        ("", '<actuator><position joint="first"/></actuator>'),
        ("", '<equality><joint joint1="j/2" joint2="first"/></equality>'),
    ],
)
def test_joints_that_no_servo_of_their_own_turns(kind: str, more: str, tmp_path: Path) -> None:
    text = two(kind=kind, more=more).replace("<joint axis", '<joint name="first" axis')
    body = drafted(text, tmp_path)
    assert body.model.njnt == 1 and body.model.joint(0).name == "first"
    shows(body.notes[0])


def test_a_body_that_faces_y_is_turned(tmp_path: Path) -> None:
    body = drafted(humanoid(), tmp_path)
    turned = facing_x(body, np.array([0.0, 1.0, 0.0]))
    written = mujoco.MjModel.from_xml_string(turned.content.decode())
    data = mujoco.MjData(written)
    mujoco.mj_kinematics(written, data)
    assert data.body("p1").xpos[1] == pytest.approx(0.05)  # its left is y now
    alike(turned.model, written)


SIZELESS = {
    "body.xml": (two(geom='<geom type="capsule" size="0.02 0"/>'), "body.xml:3"),
    "body.urdf": (humanoid().replace('<box size="0.08 0.08 0.08"/>', '<sphere radius="0"/>'), "body.urdf:6"),
}


@pytest.mark.parametrize("name", SIZELESS)
def test_a_shape_of_no_size_is_found_by_its_link_and_line(name: str, tmp_path: Path) -> None:
    text, where = SIZELESS[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    link = "link_2" if name == "body.xml" else "face"
    with refuses(InputError, where=where, found=link):
        draft_body(read_source(path))
    with refuses(InputError, where=where):
        load_body(path)


def test_every_mesh_stays_in_pictures_however_many_frames_are_fixed_to_the_body(tmp_path: Path) -> None:
    """Their offsets say nothing of how large it is; a dense mesh keeps its share of the triangles."""
    (tmp_path / "foot.stl").write_bytes(binary_stl())
    frames = "".join(
        f'<link name="imu_{i}"/><joint name="to_imu_{i}" type="fixed"><parent link="base"/><child link="imu_{i}"/>'
        f'<origin xyz="0 3 {i}"/></joint>'
        for i in range(30)
    )
    text = humanoid().replace(FOOT, '<mesh filename="foot.stl"/>')
    root = re.search(r'<link name="(.*?)"', text)
    assert root is not None
    body = drafted(text.replace("</robot>", frames.replace('"base"', f'"{root[1]}"') + "</robot>"), tmp_path)
    plain = drafted(text, tmp_path)
    looks = [
        [geom.triangles for geom in load_body_text(one.content.decode(), source="test").geoms if geom.kind == "mesh"]
        for one in (plain, body)
    ]
    assert len(looks[0]) == len(looks[1]) == 2
    for one, other in zip(*looks, strict=True):
        assert one is not None and other is not None
        np.testing.assert_allclose(np.ptp(one, axis=(0, 1)), np.ptp(other, axis=(0, 1)), atol=1e-4)
