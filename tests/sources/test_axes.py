"""Which way is up and forward in a file, decided by the body in it: any of six axes, any heading, mirrored or not."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import refuses, shows
from retarget.errors import UsageError
from retarget.sources.axes import UP_AXES, axes_with_up, forward_sign, named_axis, world_axes
from retarget.types import FloatArray

UPS = tuple(UP_AXES)


def performer(
    *, lying: bool = False, at: float = 0.0, heading: float = 0.0, bend: float = 0.1
) -> dict[str, FloatArray]:
    """Tracks (9, 3) m of a person who stands with this heading (lying: on their face, head along it) and sways, z up;
    `at`: m along x and y."""
    points = {"head": (0.02, 0.0, 1.6)}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        points |= {f"{side}_hip": (0.0, 0.1 * sign, 0.9), f"{side}_knee": (bend, 0.1 * sign, 0.5)}
        points |= {f"{side}_ankle": (0.0, 0.1 * sign, 0.1), f"{side}_toe": (0.15, 0.12 * sign, 0.02)}
    sway = 0.02 * np.sin(np.linspace(0.0, 6.0, 9))[:, None] * np.array([0.0, 1.0, 0.0])
    tracks = {name: np.array(point) + sway for name, point in points.items()}
    if lying:
        tracks = {name: np.stack((p[:, 2], p[:, 1], 0.2 - p[:, 0]), axis=1) for name, p in tracks.items()}
    c, s = np.cos(heading), np.sin(heading)
    turn, place = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([at, at, 0.0])
    return {name: track @ turn + place for name, track in tracks.items()}


def in_file(tracks: dict[str, FloatArray], axes: FloatArray, unit: float = 1.0) -> dict[str, FloatArray]:
    """The tracks of a file whose world axes are these."""
    return {name: track @ axes / unit for name, track in tracks.items()}


@settings(max_examples=60, deadline=None)
@given(
    up=st.sampled_from(UPS),
    declared=st.sampled_from((None, *UPS)),
    mirrored=st.booleans(),
    heading=st.floats(-np.pi, np.pi),
    lost=st.booleans(),
)
def test_a_body_that_stands_is_upright_and_faces_its_front_whatever_the_file_says(
    up: str, declared: str | None, mirrored: bool, heading: float, lost: bool
) -> None:
    turned = axes_with_up(UP_AXES[up]) * (np.array([[1.0], [-1.0], [1.0]]) if mirrored else 1.0)
    tracks = in_file(performer(at=1.0, heading=heading), turned, unit=0.01)
    if lost:
        tracks["head"][3] = np.nan
    axes, notes = world_axes(tracks, declared=None if declared is None else UP_AXES[declared], default=UP_AXES["y"])
    np.testing.assert_array_equal(axes[2], UP_AXES[up])
    assert np.linalg.det(axes) == (-1.0 if mirrored else 1.0)
    assert forward_sign({name: track @ axes.T for name, track in tracks.items()}) == 1.0
    assert len(notes) == (declared != up) + mirrored


def test_a_body_that_lies_keeps_the_axis_of_its_file_and_the_user_overrules_both() -> None:
    z_up = in_file(performer(lying=True, at=-0.2), np.eye(3))
    axes, notes = world_axes(z_up, declared=UP_AXES["z"], default=UP_AXES["y"])
    np.testing.assert_array_equal(axes, np.eye(3))
    shows(notes[0], "--up=x")
    axes, notes = world_axes(z_up, declared=UP_AXES["y"], declared_by="the rest pose", default=UP_AXES["y"])
    np.testing.assert_array_equal(axes[2], UP_AXES["x"])
    shows(notes[0], "--up")
    for asked in UPS:
        axes, notes = world_axes(z_up, declared=UP_AXES["z"], default=UP_AXES["y"], chosen=named_axis(asked.upper()))
        np.testing.assert_array_equal(axes[2], UP_AXES[asked])
        shows(notes[0], "--up")
    far = in_file(performer(lying=True, at=7.0), np.eye(3)) | {"extra": np.zeros((9, 3))}
    assert world_axes(far, declared=UP_AXES["y"], default=UP_AXES["y"])[1] == ()


def test_without_a_head_or_ankles_the_file_decides() -> None:
    tracks = performer()
    for lacking in ("head", "l_ankle"):
        some = {name: track for name, track in tracks.items() if name != lacking}
        assert world_axes(some, declared=UP_AXES["y"], default=UP_AXES["z"])[1] == ()
        axes, notes = world_axes(some, declared=None, default=UP_AXES["x"])
        np.testing.assert_array_equal(axes[2], UP_AXES["x"])
        shows(notes[0], "--up")


def test_toes_and_knees_that_disagree_or_are_unknown_show_no_front() -> None:
    backward = performer(bend=-0.1)
    assert forward_sign(backward) == 0.0
    for degrees, sign in ((20.0, 1.0), (5.0, 1.0), (0.0, 0.0), (-5.0, 0.0), (-12.0, 0.0), (-20.0, -1.0)):
        legs = performer(bend=0.4 * np.tan(np.radians(0.5 * degrees)))
        assert forward_sign({name: track for name, track in legs.items() if "toe" not in name}) == sign
    assert forward_sign({"head": backward["head"]}) == 0.0
    assert np.linalg.det(world_axes(backward, declared=UP_AXES["z"], default=UP_AXES["z"])[0]) == 1.0


def test_axes_that_are_none_are_refused() -> None:
    np.testing.assert_array_equal(named_axis("+Z"), UP_AXES["z"])
    with refuses(UsageError, where="--up", allowed=UPS):
        named_axis("w")
