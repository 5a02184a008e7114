"""Where all observers act: the velocity damper over a whole frame, and the way out of contact."""

import numpy as np
import pytest

from observed import BOX, CARTS, CYLINDER, POINT, Rig, Shape, aim, ball, chain, rig, rod, wall
from retarget._solver import Braking, Solver, Task
from retarget.types import FloatArray

DT, SPEED, INFLUENCE = 0.02, 0.5, 0.1
ITERATIONS = [1, 2, 3, 5, 10]
TIP = (0.2, 0.0, 0.0)


def floor(distance: float, *, margin: float, dt: float = DT, speed: float = SPEED) -> float:
    """Least distance after a frame: d' = -speed (d - margin) / (influence - margin), integrated."""
    return margin + (min(distance, INFLUENCE) - margin) * float(np.exp(-speed * dt / (INFLUENCE - margin)))


def before_ball(
    distance: float, n_ik: int, *, margin: float = 0.01, reactive: float | None = None
) -> tuple[Rig, Solver]:
    """A ball, another one in its way along x, so far off; `reactive`: speed of the way out."""
    made = rig(POINT, [ball(1, margin=margin)], [ball(at=(0.1 + distance, 0.0, 0.0), influence=INFLUENCE)])
    observing = [] if reactive is None else [Task.reactive(speed=reactive)]
    levels = [*([task] for task in observing), [Task.preventive(speed=SPEED)], [Task.position(1)]]
    return made, made.solver(levels, activation="all", n_ik=n_ik)


@pytest.mark.parametrize("n_ik", ITERATIONS)
@pytest.mark.parametrize("distance", [0.12, 0.1, 0.06, 0.0101, 0.01])
def test_a_straight_approach_ends_on_the_law(distance: float, n_ik: int) -> None:
    """Whatever the number of iterations, with a target beyond the obstacle; frame after frame."""
    made, solver = before_ball(distance, n_ik)
    targets = aim(solver, l1_0=(0.5, 0.0, 0.0))
    for _ in range(20):
        least = floor(distance, margin=0.01)
        distance = float(made.near(solver.frame(targets, DT)).distance[0])
        assert distance >= least - 1e-12
        if n_ik > 2:  # one iteration goes 5 cm at most
            assert distance == pytest.approx(least, abs=1e-7)


def stopped(braking: Braking, q: FloatArray, step: FloatArray) -> FloatArray:
    """Where a body rests that went by `step` to q in the last tick, all joints braked in proportion."""
    ticks = braking.ticks(step)
    return np.asarray(q + step * sum(1.0 - tick / ticks for tick in range(1, int(ticks) + 1)))


@pytest.mark.parametrize("speed", [1.5, 2.5])
@pytest.mark.parametrize("acceleration", [2.0, 5.0])
def test_a_body_that_brakes_at_any_moment_stops_before_the_margin(speed: float, acceleration: float) -> None:
    """A wall bars x, while y goes twice as fast: joints that brake in proportion take as long as y needs."""
    made = rig(POINT, [ball(1, margin=0.01)], [wall(quat=(0.5**0.5, 0.0, -(0.5**0.5), 0.0), at=(0.5, 0.0, 0.0))])
    levels = [[Task.preventive(speed=SPEED)], [Task.position(1)]]
    far, fastest = np.full(3, 100.0), speed * np.array([0.5, 1.0, 1.0])
    solver = made.solver(levels, activation="all", n_ik=5, max_velocity=fastest, acceleration=acceleration)
    braking = Braking(-far, far, fastest, np.full(3, acceleration), dt=DT)
    q, nearest = np.zeros(3), np.inf
    for k in range(300):
        before, q = q, solver.frame(aim(solver, l1_0=(1.0 if k > 50 else 0.0, 30.0, 0.0)), DT).copy()
        nearest = min(nearest, float(made.near(stopped(braking, q, q - before)).distance[0]))
        assert nearest >= 0.01 - 1e-9
    assert nearest < 0.011  # it came there, nevertheless


@pytest.mark.parametrize("seed", [8, 14, 20])
def test_where_it_would_come_to_rest_a_part_keeps_its_margin_with_its_other_end_too(seed: int) -> None:
    """A bar is led about boxes by jumps, and turns: what is nearest now is not what is nearest when it rests."""
    rng = np.random.default_rng(seed)
    bar = Shape(BOX, (0.12, 0.02, 0.02), 2, at=(0.1, 0.0, 0.0), margin=0.01)
    made = rig(chain(2), [bar], [Shape(BOX, (0.05, 0.05, 0.05), at=at) for at in ((0.45, 0.1, 0.0), (0.1, -0.4, 0.0))])
    fastest, acceleration, dt = np.full(2, 3.0), 40.0, 0.008
    levels = [[Task.preventive(speed=SPEED)], [Task.posture(np.ones(2))]]
    solver = made.solver(levels, activation="all", n_ik=5, max_velocity=fastest, acceleration=acceleration)
    braking = Braking(-np.full(2, 9.0), np.full(2, 9.0), fastest, np.full(2, acceleration), dt=dt)
    q, nearest = np.array([1.5, 0.0]), np.inf
    solver.reset(q)
    for k in range(1200):
        if k % 60 == 0:
            goal = rng.uniform(-2.5, 2.5, 2)
        before, q = q, solver.frame(aim(solver, l1_0=goal), dt).copy()
        nearest = min(nearest, float(made.near(stopped(braking, q, q - before)).distance.min()))
        assert nearest > 0.0095
    assert nearest < 0.012  # it came there, nevertheless


def test_two_parts_that_come_at_each_other_stop_before_the_margin() -> None:
    """One goes twice as fast as the other, and aside as well."""
    made = rig(CARTS, [ball(1, margin=0.01), ball(2, at=(0.5, 0.0, 0.0))], pairs=[(0, 1)])
    levels = [[Task.preventive(speed=SPEED)], [Task.position(1), Task.position(2)]]
    fastest, slowed, dt = np.array([1.0, 2.0, 2.0, 2.0]), np.full(4, 5.0), 0.008
    solver = made.solver(levels, activation="all", n_ik=5, max_velocity=fastest, max_acceleration=slowed)
    braking = Braking(-np.full(4, 9.0), np.full(4, 9.0), fastest, slowed, dt=dt)
    q, nearest = np.zeros(4), np.inf
    for _ in range(250):
        before, q = q, solver.frame(aim(solver, l1_0=(1.0, 0.02, 0.0), l1_1=(-1.0, 0.0, 0.0)), dt).copy()
        nearest = min(nearest, float(made.near(stopped(braking, q, q - before)).distance[0]))
        assert nearest >= 0.01
    assert nearest < 0.02  # they met, nevertheless


@pytest.mark.parametrize("away", [0.15, 0.19, 0.225])
def test_where_an_obstacle_will_be_at_the_time_of_rest_it_is_not_met(away: float) -> None:
    """A ball comes across the way, and at any moment braking ends beside it, not where it has come to by then."""
    made = rig(POINT, [ball(1, margin=0.01)], [ball(at=(0.5, away, 0.0), margin=0.01)])
    made.velocity = np.array([[0.0, -0.3, 0.0]])
    levels = [[Task.preventive(speed=SPEED)], [Task.position(1)]]
    fastest, slowed, dt = np.full(3, 1.0), np.full(3, 4.0), 0.008
    solver = made.solver(levels, activation="all", n_ik=5, max_velocity=fastest, max_acceleration=slowed)
    braking = Braking(-np.full(3, 9.0), np.full(3, 9.0), fastest, slowed, dt=dt)
    q, nearest = np.zeros(3), np.inf
    for _ in range(150):
        made.show(solver)
        before, q = q, solver.frame(aim(solver, l1_0=(1.0, 0.0, 0.0)), dt).copy()
        made.at = made.at + dt * made.velocity
        later = dt * (braking.ticks(q - before) - 1.0)
        nearest = min(nearest, float(made.near(stopped(braking, q, q - before), later=later).distance[0]))
        assert nearest > 0.009
    assert nearest < 0.02  # it was in the way, nevertheless


@pytest.mark.parametrize("beyond", [0.0, 0.02, 0.04], ids=["to its middle", "past its middle", "far past it"])
def test_what_would_stop_beyond_the_middle_of_an_obstacle_is_slowed_not_led_through_it(beyond: float) -> None:
    """A solver starts anew in the midst of a motion: the shortest way out of a ball is then the way on."""
    made = rig(POINT, [ball(1, 0.02, margin=0.01)], [ball(0, 0.03, at=(0.1, 0.0, 0.0))])
    levels, acceleration = [[Task.preventive(speed=SPEED)], [Task.position(1)]], 10.0
    solver = made.solver(levels, activation="all", n_ik=5, acceleration=acceleration)
    speed = float(np.sqrt(2.0 * acceleration * (0.1 + beyond))) - acceleration * DT
    solver.reset(np.zeros(3), np.array([speed, 0.0, 0.0]))
    for _ in range(3):
        solver.frame(aim(solver, l1_0=(1.0, 0.0, 0.0)), DT)
        assert solver.velocity[0] < speed - 0.5 * acceleration * DT
        speed = float(solver.velocity[0])


@pytest.mark.parametrize("far", [0.3, 0.5])
@pytest.mark.parametrize("beyond", [0.0, 0.03])
def test_who_would_stop_on_the_far_side_of_a_plate_stops_before_it(far: float, beyond: float) -> None:
    made = rig(POINT, [ball(1, 0.02, margin=0.01)], [Shape(BOX, (0.005, 0.5, 0.5), at=(far, 0.0, 0.0))])
    levels, acceleration = [[Task.preventive(speed=SPEED)], [Task.position(1)]], 10.0
    solver = made.solver(levels, activation="all", n_ik=5, acceleration=acceleration)
    speed = float(np.sqrt(2.0 * acceleration * (far + beyond))) - acceleration * DT
    solver.reset(np.zeros(3), np.array([speed, 0.0, 0.0]))
    for _ in range(100):
        q = solver.frame(aim(solver, l1_0=(far + 0.5, 0.0, 0.0)), DT)
    assert made.near(q).distance[0] == pytest.approx(0.01, abs=1e-4) and q[0] < far


def test_an_obstacle_that_is_taken_away_leaves_no_row_behind() -> None:
    made = rig(POINT, [ball(1, margin=0.01)], [ball(at=(0.3, 0.0, 0.0))])
    levels = [[Task.preventive(speed=SPEED)], [Task.position(1)]]
    solvers = [made.solver(levels, activation="all", n_ik=5, acceleration=10.0) for _ in range(2)]
    for solver in solvers:
        solver.reset(np.zeros(3), np.array([1.8, 0.0, 0.0]))
    for tick in range(6):
        solvers[0].set_obstacles(made.at, made.quat, made.velocity, present=np.array([tick < 3]))
        if tick == 3:
            solvers[1].reset(solvers[0].q, solvers[0].velocity)
        solvers[1].set_obstacles(made.at, made.quat, made.velocity, present=np.array([False]))
        here, free = (solver.frame(aim(solver, l1_0=(1.0, 0.0, 0.0)), DT) for solver in solvers)
        assert (tick < 3) == (free[0] - here[0] > 1e-3)


def test_inside_the_margin_it_comes_out_at_the_same_law_while_it_moves_along() -> None:
    made = rig(POINT, [ball(1, margin=0.01)], [wall(quat=(0.5**0.5, 0.0, -(0.5**0.5), 0.0), at=(0.054, 0.0, 0.0))])
    solver = made.solver([[Task.preventive(speed=SPEED)], [Task.position(1)]], activation="all", acceleration=50.0)
    solver.reset(np.zeros(3), np.array([0.0, 0.5, 0.0]))
    solver.frame(aim(solver, l1_0=(0.0, 1.0, 0.0)), DT)
    assert made.near(solver.q).distance[0] == pytest.approx(floor(0.004, margin=0.01), abs=1e-6)


def test_a_locked_coordinate_has_no_velocity() -> None:
    made = rig(POINT, [ball(1)], [ball(at=(0.3, 0.0, 0.0))])
    locked = np.array([True, False, False])
    solver = made.solver([[Task.preventive(speed=SPEED)], [Task.position(1)]], activation="all", locked=locked)
    solver.reset(np.zeros(3), np.array([1.0, 0.5, 0.0]))
    assert solver.velocity.tolist() == [0.0, 0.5, 0.0]


@pytest.mark.parametrize("n_ik", ITERATIONS)
@pytest.mark.parametrize("goal", [None, (0.5, 0.0, 0.0)], ids=["nothing asked", "asked inward"])
def test_inside_the_margin_it_comes_out_at_the_same_law(n_ik: int, goal: tuple[float, float, float] | None) -> None:
    made, solver = before_ball(0.004, n_ik)
    targets = aim(solver) if goal is None else aim(solver, l1_0=goal)
    q = solver.frame(targets, DT)
    assert made.near(q).distance[0] == pytest.approx(floor(0.004, margin=0.01), abs=1e-7)
    for _ in range(200):
        q = solver.frame(targets, DT)
    assert made.near(q).distance[0] == pytest.approx(0.01, abs=1e-6)


@pytest.mark.parametrize("velocity", [0.0, 1e-9], ids=["from rest", "from the slightest motion"])
def test_from_rest_it_comes_out_no_faster_than_joints_do_with_ease(velocity: float) -> None:
    """A quarter of the way that accelerations allow in the first frame, the law later; and it arrives."""
    made = rig(POINT, [ball(1, margin=0.01)], [ball(at=(0.104, 0.0, 0.0), influence=INFLUENCE)])
    solver = made.solver([[Task.preventive(speed=SPEED)]], activation="all", n_ik=1, acceleration=1.0)
    targets = aim(solver)
    solver.reset(np.zeros(3), np.array([velocity, 0.0, 0.0]))
    first = made.near(solver.frame(targets, DT)).distance[0] - 0.004
    assert first == pytest.approx(0.25 * 1.0 * DT**2, rel=1e-6) and first < floor(0.004, margin=0.01) - 0.004
    for _ in range(400):
        q = solver.frame(targets, DT)
    assert made.near(q).distance[0] == pytest.approx(0.01, abs=1e-4)


def test_the_tangent_plane_is_free_along_a_wall() -> None:
    made = rig(POINT, [ball(1)], [wall(quat=(0.5**0.5, 0.0, -(0.5**0.5), 0.0), at=(0.07, 0.0, 0.0))])
    solver = made.solver([[Task.preventive(speed=SPEED)], [Task.position(1)]], activation="all", n_ik=4)
    q = solver.frame(aim(solver, l1_0=(0.05, 0.04, -0.03)), DT)
    assert q == pytest.approx([0.02 - floor(0.02, margin=0.0), 0.04, -0.03], abs=1e-7)


@pytest.mark.parametrize("shape", [Shape(BOX, (0.05, 0.06, 0.07)), Shape(CYLINDER, (0.05, 0.08, 0.0)), ball()])
@pytest.mark.parametrize("n_ik", [2, 5, 10])
@pytest.mark.parametrize("speed", [3.0, 100.0])
def test_a_chain_whose_way_is_barred_keeps_every_floor(shape: Shape, n_ik: int, speed: float) -> None:
    """Its tip is asked to go through an obstacle. Floors are kept to first order; the rest is what a frame's last step
    curves."""
    where = (0.45, 0.12, 0.0)
    made = rig(chain(5), [rod(k + 1) for k in range(5)], [Shape(shape.kind, shape.size, at=where)])
    tip = Task.position(5, TIP, weight=(1.0, 1.0, 0.0))
    levels = [[Task.preventive(speed=SPEED)], [tip]]
    solver = made.solver(levels, activation="all", n_ik=n_ik, speed=speed, damping=1.0)
    q = np.array([-0.7, 0.3, 0.3, 0.2, 0.2])
    solver.reset(q)
    start = made.body.points(q[None], [5], np.array([TIP]))[0, 0]
    end, before, near = np.array([0.2, 0.4, 0.0]), made.near(q).distance, []
    for k in range(120):
        goal = start + min(k / 60, 1.0) * (end - start)
        now = made.near(solver.frame(aim(solver, l1_0=goal), DT)).distance
        least = np.where(before > 0.11, -np.inf, [floor(d, margin=0.0) for d in before])
        assert (now >= least - 6e-4).all()
        near.append(now.min())
        before = now
    assert 0.0 < min(near) < 1e-3  # it was in the way, and was not entered


@pytest.mark.parametrize("n_ik", ITERATIONS)
@pytest.mark.parametrize("depth", [0.03, 0.002])
def test_out_of_contact_at_this_speed_and_no_faster(depth: float, n_ik: int) -> None:
    """Up to the margin; from there the damper keeps it."""
    made, solver = before_ball(-depth, n_ik, reactive=0.1)
    distance, targets, reactive = -depth, aim(solver, l2_0=(0.5, 0.0, 0.0)), 0
    for _ in range(40):
        at_most = min(distance + 0.1 * DT, 0.01) if distance < -5e-5 else floor(distance, margin=0.01)
        distance = float(made.near(solver.frame(targets, DT)).distance[0])
        assert distance == pytest.approx(at_most, abs=1e-7)
        reactive += solver.observer_modes[0] == 2
    assert reactive == pytest.approx(depth / (0.1 * DT), abs=1.01)


@pytest.mark.parametrize("activation", ["closest", "all"])
def test_all_that_touch_share_one_level(activation: str) -> None:
    """Between two obstacles, 1 and 2 cm deep in them: both cannot be solved, and neither goes before the other."""
    made = rig(POINT, [ball(1)], [ball(at=(0.08, 0.0, 0.0)), ball(at=(-0.09, 0.0, 0.0))])
    solver = made.solver([[Task.reactive(speed=0.1)], [Task.preventive()]], activation=activation)
    q = solver.frame(aim(solver), DT)
    assert q == pytest.approx([0.0, 0.0, 0.0], abs=1e-7)  # each 2 mm to its side: the least sum of squares
    assert solver.observer_modes.tolist() == [2]


def test_both_sides_of_a_pair_move() -> None:
    made = rig(CARTS, [ball(1), ball(2, at=(0.11, 0.0, 0.0))], pairs=[(0, 1)])
    levels = [[Task.preventive(speed=SPEED)], [Task.position(1), Task.position(2)]]
    solver = made.solver(levels, activation="all", n_ik=3)
    q = solver.frame(aim(solver, l1_0=(0.04, 0.0, 0.0), l1_1=(-0.04, 0.0, 0.0)), DT)
    way = 0.01 - floor(0.01, margin=0.0)
    assert q == pytest.approx([0.5 * way, 0.0, -0.5 * way, 0.0], abs=1e-7)
    assert solver.observer_modes.tolist() == [1, 1]
    assert solver.clearance[0] == pytest.approx(0.01 - way, abs=1e-7) and solver.clearance[1] == np.inf


def test_tasks_look_only_at_what_they_name() -> None:
    """`against` and `of`: the other side is free."""
    shapes, obstacles = [ball(1), ball(2, at=(0.11, 0.0, 0.0))], [ball(at=(-0.11, 0.0, 0.0))]
    made = rig(CARTS, shapes, obstacles, [(0, 1)])
    goals = [Task.position(1), Task.position(2)]
    for task, away, held in (
        (Task.preventive(against="self"), 0.02, True),
        (Task.preventive(against="scene"), 0.02, False),
        (Task.preventive(against="scene"), -0.02, True),
        (Task.preventive(of=[1], against="scene"), -0.02, False),
        (Task.preventive(of=[0]), -0.02, True),
        (Task.preventive(of=[1]), 0.02, True),
    ):
        solver = made.solver([[task], goals], activation="all", n_ik=3)
        q = solver.frame(aim(solver, l1_0=(away, 0.0, 0.0), l1_1=(0.0, 0.0, 0.0)), DT)
        assert (abs(q[0]) < 0.0199) == held, (away, held)
