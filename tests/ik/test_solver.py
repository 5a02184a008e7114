"""`retarget.ik`: the library of docs/ik.md."""

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from retarget import ik, rotations
from retarget.errors import ConfigError, UsageError
from retarget.model.body import BodyModel

LINK = '<geom type="capsule" fromto="0 0 0 {length} 0 0" size="0.02"/>'


def arm(name: str = "", y: float = 0.0, extra: str = "") -> str:
    """Three hinges at 0.3 m above the table's middle, of two links of 0.3 and 0.25 m."""
    return f"""<body name="{name}upper" pos="0 {y} 0.3"><joint name="{name}turn" axis="0 0 1" range="-170 170"/>
      <joint name="{name}lift" axis="0 1 0" range="-100 100"/>{LINK.format(length=0.3)}
      <body name="{name}lower" pos="0.3 0 0"><joint name="{name}elbow" axis="0 1 0" range="-150 150"/>
        {LINK.format(length=0.25)}{extra}<site name="{name}hand" pos="0.25 0 0"/></body></body>"""


def body(*parts: str) -> BodyModel:
    return ik.load_body_text(f"<mujoco><worldbody>{''.join(parts)}</worldbody></mujoco>", source="test arm")


START = [0.0, -0.5, 1.0]


def settled(solver: ik.Solver, targets: dict[Any, Any], frames: int = 300) -> None:
    for _ in range(frames):
        solver.solve(targets, 0.01)


def test_the_public_names_are_those_of_the_module(tmp_path: Path) -> None:
    classes = {name: made for name, made in vars(ik.solver).items() if inspect.isclass(made)}
    own = {name for name, made in classes.items() if made.__module__ == ik.solver.__name__}
    assert sorted(ik.__all__) == sorted(own | {"load_body", "load_body_text"})
    page = (Path(__file__).resolve().parents[2] / "docs/ik.md").read_text(encoding="utf-8")
    assert all(f"`{name}" in page or f"ik.{name}" in page for name in ik.__all__)
    file = tmp_path / "arm.xml"
    file.write_text(f"<mujoco><worldbody>{arm()}</worldbody></mujoco>", encoding="utf-8")
    assert ik.load_body(str(file)).joint_names == ik.load_body(file).joint_names == ("turn", "lift", "elbow")


@given(st.floats(-1.0, 1.0), st.floats(0.2, 0.5), st.floats(-0.5, 0.5))
def test_what_is_within_reach_is_reached(side: float, far: float, up: float) -> None:
    hand = ik.Position("hand")
    solver = ik.Solver(body(arm()), [[hand], [ik.Posture()]], start=START)
    target = np.array([0.0, 0.0, 0.3]) + far * np.array(
        [np.cos(side) * np.cos(up), np.sin(side) * np.cos(up), np.sin(up)]
    )
    settled(solver, {hand: target})
    assert solver.error(hand) < 1e-6
    assert solver.position("hand") == pytest.approx(target, abs=1e-6)
    assert (solver.q >= solver.body.lower).all() and (solver.q <= solver.body.upper).all()


def test_a_higher_level_gives_nothing_to_a_lower_one() -> None:
    elbow, hand, balance = ik.Position("lower"), ik.Position("hand"), ik.CentreOfMass()
    solver = ik.Solver(body(arm()), [[elbow], [hand, balance], [ik.Posture()]], start=START)
    at = solver.position("lower")
    settled(solver, {elbow: at, hand: (2.0, 1.0, 0.0), balance: (0.0, 0.0, 9.0)})
    assert solver.error(elbow) < 1e-6 < 0.5 < solver.error(hand)


def test_a_turn_is_met_within_the_speed_of_joints() -> None:
    hand = ik.Orientation("hand")
    solver = ik.Solver(body(arm()), [[hand], [ik.Posture()]], start=START, max_velocity=1.5, max_acceleration=30.0)
    speeds = []
    for _ in range(200):
        solver.solve({hand: (2.0, 0.0, 0.0, 2.0)}, 0.01)  # a quarter turn to the left; its length does not matter
        speeds.append(solver.velocity)
    assert solver.error(hand) < 1e-6
    assert rotations.angle_between(solver.orientation("hand"), [1.0, 0.0, 0.0, 1.0]) < 1e-6
    assert np.abs(speeds).max() == pytest.approx(1.5, abs=1e-9)
    assert np.abs(np.diff(speeds, axis=0)).max() < 30.0 * 0.01 + 1e-9


@pytest.mark.parametrize("frame", ["hand", None])
def test_half_spaces_come_before_what_is_below_them(frame: str | None) -> None:
    inside, hand = ik.HalfSpaces(frame, most=2), ik.Position("hand")
    solver = ik.Solver(body(arm()), [[inside], [hand], [ik.Posture()]], start=[0.0, 0.5, 0.5])
    spaces = np.array([[1.0, 0.0, 0.0, 0.15], [0.0, 0.6, 0.8, 0.35]])
    settled(solver, {inside: spaces, hand: (0.5, 0.2, 0.4)})
    at = solver.centre_of_mass if frame is None else solver.position("hand")
    beyond = spaces[:, :3] @ at - spaces[:, 3]
    assert beyond.max() < 1e-6 and solver.error(inside) < 1e-6
    assert solver.error(hand) > 0.02
    settled(solver, {inside: [[-1.0, 0.0, 0.0, 0.1]], hand: (0.4, 0.1, 0.4)})  # the other one is gone
    assert solver.error(hand) < 1e-4
    solver.solve({inside: []}, 0.01)
    assert solver.error(inside) == 0.0


def test_parts_keep_clear_of_each_other_and_of_the_world() -> None:
    table = '<geom name="table" type="box" size="0.6 0.6 0.02"/><geom type="plane" pos="0 0 -0.5" size="1 1 1"/>'
    left, right = ik.Position("left hand"), ik.Position("right hand")
    made = body(table, arm("left ", 0.2), arm("right ", -0.2))
    crossed = {left: (0.4, -0.1, 0.0), right: (0.4, 0.1, 0.0)}
    nearest = []
    for levels in ([[ik.KeepClear(margin=0.02)], [left], [right]], [[left], [right]]):
        solver, apart = ik.Solver(made, [*levels, [ik.Posture()]], start=START * 2, max_velocity=2.0), []
        for _ in range(300):
            solver.solve(crossed, 0.01)
            apart.append(min(solver.clearance, solver.position("left hand")[2] - 0.04))
        nearest.append(min(apart))
    assert nearest[0] > 0.0195 and nearest[1] < -0.02


def test_what_may_touch_is_left_out() -> None:
    made = body('<geom name="floor" type="plane" pos="0 0 0.29" size="1 1 1"/>', arm())  # the upper arm is in the floor
    solver = ik.Solver(made, [[ik.KeepClear()], [ik.Posture()]], start=[0.0, 0.0, -0.5])
    settled(solver, {}, 20)
    assert solver.q == pytest.approx([0.0, 0.0, -0.5], abs=1e-9)
    two = body(arm("left ", 0.02), arm("right ", -0.02))
    with refuses(ConfigError, "touch"):
        ik.Solver(two, [[ik.KeepClear()]], start=START * 2)
    pairs = [(f"left {one}", f"right {other}") for one in ("upper", "lower") for other in ("upper", "lower")]
    ik.Solver(two, [[ik.KeepClear(ignored=tuple(pairs))]], start=START * 2)


def test_a_free_body_and_locked_joints() -> None:
    text = f'<mujoco><worldbody><body name="base"><geom size="0.1"/>{arm()}</body></worldbody></mujoco>'
    floating = ik.load_body_text(text, source="floating", root="free")
    hand, base = ik.Position("hand"), ik.Position("base")
    solver = ik.Solver(floating, [[base], [hand]], locked=["elbow"])
    elbow = floating.joint_qpos[floating.joint_index("elbow")]
    before = float(solver.q[elbow])
    settled(solver, {base: (1.0, 0.0, 0.5), hand: (1.0, 0.5, 0.5)})
    assert solver.error(base) < 1e-6 and solver.q[elbow] == before


def test_errors_and_clearance_are_those_of_the_last_solve_and_of_a_task_with_a_target() -> None:
    hand, clear = ik.Position("hand"), ik.KeepClear(influence=10.0)
    solver = ik.Solver(body('<geom type="plane" size="1 1 1"/>', arm()), [[clear], [hand]], start=START)
    for _ in range(2):
        assert np.isnan([solver.clearance, solver.error(hand), solver.error(clear)]).all()
        solver.solve({hand: solver.position("hand")}, 0.01)
        assert np.isfinite([solver.clearance, solver.error(hand), solver.error(clear)]).all()
        solver.reset(START)
    assert solver.capped == 0
    solver = ik.Solver(body(arm()), [[hand], [ik.Posture(gain=1.0)]], start=START)
    settled(solver, {hand: (0.3, 0.2, 0.3)}, 100)
    assert solver.error(hand) < 1e-6
    settled(solver, {}, 100)
    assert np.isnan(solver.error(hand)) and solver.q == pytest.approx(START, abs=1e-6)


@pytest.mark.parametrize("iterations", [1, 2])
def test_a_long_frame_goes_only_as_far_as_its_iterations(iterations: int) -> None:
    """The numbers of docs/ik.md and of the docstrings."""
    made, far = body(arm()), np.array([1.5, 0.2, 0.5])
    joints, turn, hand = ik.Posture(gain=1.0), ik.Orientation("upper"), ik.Position("hand")
    solver = ik.Solver(made, [[joints]], start=[0.0] * 3, iterations=iterations)
    solver.solve({joints: far}, 1.0)
    assert np.abs(solver.q).max() == pytest.approx(0.3 * iterations)
    solver = ik.Solver(made, [[turn]], start=[0.0] * 3, iterations=iterations)
    solver.solve({turn: (2.0, 0.0, 0.0, 2.0)}, 1.0)
    assert 0.1 * iterations < solver.q[0] <= 0.2 * iterations + 1e-9
    solver = ik.Solver(made, [[hand]], start=START, iterations=iterations)
    before = solver.position("hand")
    solver.solve({hand: before + np.array([0.0, 0.3, 0.0])}, 1.0)
    assert 0.02 * iterations < np.linalg.norm(solver.position("hand") - before) < 0.055 * iterations


def test_parts_in_contact_go_apart_at_a_tenth_of_a_metre_per_second() -> None:
    hand, clear = ik.Position("hand"), ik.KeepClear(margin=0.01, influence=0.03)
    solver = ik.Solver(body('<geom type="plane" size="1 1 1"/>', arm()), [[clear], [hand]], start=START)
    unwatched = ik.Solver(solver.body, [[hand]], start=START)
    below = {hand: (0.4, 0.0, 0.0)}  # there the capsule's end is 2 cm in the floor
    settled(unwatched, below)
    solver.reset(unwatched.q)
    depth = []
    for _ in range(10):
        solver.solve(below, 0.01)
        depth.append(solver.clearance)
    assert depth[0] < -0.015 and np.diff(depth) == pytest.approx(0.001, abs=2e-4)


HAND = ik.Position("hand")
ODD: Any = ik  # for arguments of a wrong type
WRONG_TARGETS: dict[str, tuple[Any, ...]] = {
    "target of Position('hand')": ((0.1, 0.2), "left", (0.1, np.nan, 0.0), [True] * 3, ["1", "2", "3"], [[1, 2], [3]]),
    "target of Orientation('hand')": ((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    "target of HalfSpaces('hand')": (
        *([[0.0, 0.0, 2.0, 0.1]], [[0.0, 0.0, 1.0, 0.1]] * 2, [0.0, 0.0, 1.0, 0.1], [1.0, 2.0]),
        *([[0.0, 0.0, 1.0, np.inf]], "up"),
    ),
    "target of Posture": ([0.0] * 2, [0.0, np.nan, 0.0]),
    "target of KeepClear": (1.0,),
}
WRONG_TASKS: dict[str, tuple[Any, ...]] = {
    "point": (ODD.Position("hand", point=(0.0, 0.0, np.nan)), ODD.HalfSpaces("hand", point=(0.0, 0.0))),
    "": (ODD.Position(3), ODD.Orientation(None), ODD.HalfSpaces(3)),
    "weight": (
        *(ODD.Position("hand", weight=(1.0, -1.0, 0.0)), ODD.Orientation("hand", weight=(1.0, np.nan, 0.0))),
        ODD.CentreOfMass(weight=1.0),
    ),
    "most": (ODD.HalfSpaces("hand", most=-1), ODD.HalfSpaces(None, most=65), ODD.HalfSpaces(None, most=2.0)),
    "gain": (ODD.Posture(gain=0.0), ODD.Posture(gain=1.1), ODD.Posture(gain="a")),
    "weights": tuple(ODD.Posture(weights=weights) for weights in (5, {"elbow": -1.0}, {"elbow": "a"}, {3: 1.0})),
    "margin, influence": (
        *(ODD.KeepClear(margin=0.1, influence=0.05), ODD.KeepClear(influence=np.inf)),
        *(ODD.KeepClear(speed=0.0), ODD.KeepClear(margin="a")),
    ),
    "ignored": tuple(ODD.KeepClear(ignored=ignored) for ignored in (5, ("upper", "lower"), (("upper",),))),
}
WRONG_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "levels": (
        *([HAND], [[HAND, "hand"]], [[HAND], [HAND]], [[ik.Posture()], [HAND]], [[HAND, ik.Posture()]]),
        *([], [[]], 5, "hand", [[ik.KeepClear()], [ik.KeepClear()]]),
    ),
    "start": ([1.0, 2.0], [0.0, 0.0, np.nan], "rest"),
    "max_velocity": ([1.0, 2.0], 0.0, np.nan, "fast", None),
    "max_acceleration": ([1.0, 2.0, -3.0],),
    "locked": (5, "elbow", [3]),
    "iterations": (0, 101, True, 2.0, "2"),
}


@pytest.mark.parametrize("place", WRONG_TARGETS)
def test_a_target_that_does_not_fit_is_refused_and_nothing_moves(place: str) -> None:
    tasks = [ik.KeepClear()], [ik.HalfSpaces("hand", most=1)], [ik.Position("hand"), ik.Orientation("hand")]
    levels: Any = [*tasks, [ik.Posture()]]
    task = next(task for level in levels for task in level if place.endswith(ik.solver._name(task)))
    solver = ik.Solver(body(arm()), levels, start=START)
    for wrong in WRONG_TARGETS[place]:
        with refuses(UsageError, where=("ik.Solver.solve", place)):
            solver.solve({task: wrong}, 0.01)
    assert np.array_equal(solver.q, START)


def test_a_call_that_does_not_fit_is_refused_and_nothing_moves() -> None:
    hand = ik.Position("hand")
    solver = ik.Solver(body(arm()), [[hand], [ik.Posture()]], start=START)
    wrong: Any
    for wrong in (0.0, -1.0, np.inf, np.nan, "a", None, True, [0.01], 10**400):
        with refuses(UsageError, where="dt", allowed="a number above 0"):
            solver.solve({}, wrong)
    for wrong in ([], 5, None):
        with refuses(UsageError, where="targets", allowed="{task: target}"):
            solver.solve(wrong, 0.01)
    for wrong in (ik.Position("hand"), "hand"):
        with refuses(UsageError, where="ik.Solver.solve", allowed="Position('hand')"):
            solver.solve({wrong: (0.1, 0.2, 0.3)}, 0.01)
    for wrong in (ik.Position("hand"), []):
        with refuses(UsageError, where="ik.Solver.error", allowed="Position('hand')"):
            solver.error(wrong)
    for wrong in ([0.0, 0.0], [0.0, 0.0, 3.0], "rest"):
        with refuses(UsageError, where="ik.Solver.reset"):
            solver.reset(wrong)
    for wrong in (3, None):
        with refuses(UsageError, where="ik.Solver.orientation", found=repr(wrong)):
            solver.orientation(wrong)
    with refuses(UsageError, where="ik.Solver.position, point", allowed="3 finite numbers"):
        solver.position("hand", point=(0.0, 0.0, np.nan))
    with refuses(ConfigError, found="hnad", next_step="hand"):
        solver.orientation("hnad")
    assert np.array_equal(solver.q, START)


@pytest.mark.parametrize("argument", [*WRONG_TASKS, *WRONG_ARGUMENTS])
def test_a_task_or_an_argument_that_cannot_be_is_refused(argument: str) -> None:
    for wrong in WRONG_TASKS.get(argument, ()):
        with refuses(UsageError, argument, where=f"ik.{type(wrong).__name__}"):
            ik.Solver(body(arm()), [[wrong]], start=START)
    for wrong in WRONG_ARGUMENTS.get(argument, ()):
        given: dict[str, Any] = {"levels": [[HAND]], "start": START} | {argument: wrong}
        with refuses(UsageError, where=f"ik.Solver, {argument}"):
            ik.Solver(body(arm()), **given)


def test_a_start_beyond_a_joint_s_range_is_refused() -> None:
    made = body(arm())
    with refuses(UsageError, where="start", found=("elbow", 3), allowed=(-2.61799, 2.61799, "rad")):
        ik.Solver(made, [[HAND]], start=[0.0, 0.0, 3.0])
    with refuses(UsageError, "turn", "lift", where="start"):
        ik.Solver(made, [[HAND]], start=[-4.0, 2.0, 0.0])
    bent = body(arm().replace('"-150 150"', '"10 150"'))  # the file's own posture is stretched
    with refuses(UsageError, where=("start", "test arm"), found=("elbow", 0)):
        ik.Solver(bent, [[HAND]])
    solver = ik.Solver(bent, [[HAND]], start=[0.0, 0.0, np.radians(10.0) - 1e-12])
    solver.reset(solver.solve({HAND: (9.0, 0.0, 0.3)}, 0.01))


def test_what_a_body_does_not_have_is_refused() -> None:
    made: Any = body(arm())
    with refuses(ConfigError, found="hnad", next_step="hand"):
        ik.Solver(made, [[ik.Position("hnad")]])
    with refuses(ConfigError, found="elbwo", next_step="elbow"):
        ik.Solver(made, [[HAND]], locked=["elbwo"])
    with refuses(ConfigError, found="elbwo", next_step="elbow"):
        ik.Solver(made, [[ik.Posture(weights={"elbwo": 2.0})]])
    with refuses(ConfigError, "ellipsoid 'egg'"):
        ik.Solver(body(arm(extra='<geom name="egg" type="ellipsoid" size="0.1 0.1 0.2"/>')), [[ik.KeepClear()]])
    made = "arm.xml"
    with refuses(UsageError, where="ik.Solver", found="arm.xml", allowed="ik.load_body"):
        ik.Solver(made, [[HAND]])
