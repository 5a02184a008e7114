"""`retarget.ik`: the library of docs/ik.md."""

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from retarget import ik
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


def test_the_public_names_are_those_of_the_module() -> None:
    tasks = {
        name
        for name, made in vars(ik.solver).items()
        if inspect.isclass(made) and made.__module__ == ik.solver.__name__
    }
    assert sorted(ik.__all__) == sorted(tasks | {"load_body", "load_body_text"})
    page = (Path(__file__).resolve().parents[2] / "docs/ik.md").read_text(encoding="utf-8")
    assert all(f"`{name}" in page or f"ik.{name}" in page for name in ik.__all__)


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


def test_a_task_without_a_target_is_left_out() -> None:
    hand = ik.Position("hand")
    solver = ik.Solver(body(arm()), [[hand], [ik.Posture(gain=1.0)]], start=START)
    settled(solver, {hand: (0.3, 0.2, 0.3)}, 100)
    assert solver.error(hand) < 1e-6
    settled(solver, {}, 100)
    assert np.isnan(solver.error(hand))
    assert solver.q == pytest.approx(START, abs=1e-6)


def test_a_free_body_and_locked_joints() -> None:
    text = f'<mujoco><worldbody><body name="base"><geom size="0.1"/>{arm()}</body></worldbody></mujoco>'
    floating = ik.load_body_text(text, source="floating", root="free")
    hand, base = ik.Position("hand"), ik.Position("base")
    solver = ik.Solver(floating, [[base], [hand]], locked=["elbow"])
    elbow = float(solver.q[floating.joint_qpos[floating.joint_index("elbow")]])
    settled(solver, {base: (1.0, 0.0, 0.5), hand: (1.0, 0.5, 0.5)})
    assert solver.error(base) < 1e-6
    assert solver.q[floating.joint_qpos[floating.joint_index("elbow")]] == elbow


def test_the_same_calls_give_the_same_bits() -> None:
    rows = []
    for _ in range(2):
        hand = ik.Position("hand")
        solver = ik.Solver(body(arm()), [[ik.KeepClear()], [hand], [ik.Posture()]], start=START, max_velocity=2.0)
        rows.append([solver.solve({hand: (0.4 - 0.002 * k, 0.003 * k, 0.3)}, 0.01) for k in range(100)])
    assert np.array_equal(rows[0], rows[1])


def test_what_is_wrong_is_refused_and_nothing_moves() -> None:
    hand, above = ik.Position("hand"), ik.HalfSpaces("hand", most=1)
    solver = ik.Solver(body(arm()), [[above], [hand], [ik.Posture()]], start=START)
    wrong: Any
    for wrong in ((0.1, 0.2), "left", (0.1, np.nan, 0.0)):
        with refuses(UsageError, "target of Position('hand')", "3 finite numbers"):
            solver.solve({hand: wrong}, 0.01)
    for wrong in ([[0.0, 0.0, 2.0, 0.1]], [[0.0, 0.0, 1.0, 0.1]] * 2, [1.0, 2.0]):
        with refuses(UsageError, "target of HalfSpaces('hand')", "of length 1"):
            solver.solve({above: wrong}, 0.01)
    with refuses(UsageError, "in none of the levels", "Position('hand')"):
        solver.solve({ik.Position("hand"): (0.1, 0.2, 0.3)}, 0.01)
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with refuses(UsageError, "dt"):
            solver.solve({}, wrong)
    with refuses(UsageError, "reset", "3 finite numbers"):
        solver.reset([0.0, 0.0])
    assert np.array_equal(solver.q, START)


def test_what_cannot_be_solved_is_refused() -> None:
    made = body(arm())
    hand = ik.Position("hand")
    wrong: Any
    with refuses(ConfigError, "hnad", "Did you mean hand?"):
        ik.Solver(made, [[ik.Position("hnad")]])
    with refuses(ConfigError, "Did you mean elbow?"):
        ik.Solver(made, [[hand]], locked=["elbwo"])
    for wrong in ([hand], [[hand, "hand"]], [[hand], [hand]], [[ik.Posture()], [hand]], [[hand, ik.Posture()]]):
        with refuses(UsageError, "ik.Solver, levels"):
            ik.Solver(made, wrong)
    with refuses(UsageError, "max_velocity"):
        ik.Solver(made, [[hand]], max_velocity=[1.0, 2.0])
    with refuses(UsageError, "start"):
        ik.Solver(made, [[hand]], start=[1.0, 2.0])
    with refuses(UsageError, "iterations"):
        ik.Solver(made, [[hand]], iterations=0)
    with refuses(UsageError, "ik.KeepClear", "margin"):
        ik.Solver(made, [[ik.KeepClear(margin=0.1, influence=0.05)]])
    for wrong in (ik.Posture(gain=0.0), ik.Position("hand", weight=(1.0, -1.0, 0.0)), ik.HalfSpaces("hand", most=-1)):
        with refuses(UsageError, f"ik.{type(wrong).__name__}"):
            ik.Solver(made, [[wrong]])
    with refuses(ConfigError, "ellipsoid 'egg'"):
        ik.Solver(body(arm(extra='<geom name="egg" type="ellipsoid" size="0.1 0.1 0.2"/>')), [[ik.KeepClear()]])
