"""Contact by current: what inverse dynamics explains is no contact, what it does not is one, soon, and gives way."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from followers import op3
from hardware.bus import ServoBus, ServoStates
from hardware.clock import Clock, VirtualClock
from hardware.motors import drive_numbers
from hardware.no_bus import NoBus
from retarget.cli.buses import posture_ticks
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody, load_robot
from retarget.run.loop import RunObserver, Tick
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from retarget.safety.contact import (
    BEGUN_S,
    CLEAR_S,
    SLOWEST_HZ,
    STUCK,
    SUSTAINED_S,
    ContactDetector,
    Press,
    felt_servos,
    return_path,
)
from retarget.safety.gate import Gate
from retarget.schema.scene import Scene
from retarget.schema.shapes import Box
from retarget.types import FloatArray, RunState
from sim.buses import physics_bus, simulation_of
from sim.performer import synthetic_performer
from sim.physics.simulation import Simulation

DT = 0.008
ARMS_AND_HEAD = ("r_sho_pitch", "l_sho_pitch", "r_sho_roll", "l_sho_roll", "r_el", "l_el", "head_pan", "head_tilt")


def standing() -> FloatArray:
    return np.asarray(op3().posture(op3().profile.postures.stand))


@cache
def still() -> ServoStates:
    """OP3 in its stance, whose arms carry their own weight."""
    bus = NoBus(VirtualClock(), start=posture_ticks(op3()))
    bus.open()
    states = bus.read()
    servos, q = op3().joint_map.servos, standing()
    gravity = 9.81 * op3().body.total_mass * op3().kinematics.centre_of_mass_jacobian(q)[2]
    constant = [servo.direction * drive_numbers(servo.model).torque_constant for servo in servos]
    carried = [gravity[op3().body.dof_index(servo.joint)] for servo in servos]
    return replace(states, current=np.array(carried) / constant)


def pressing(torque: float, *, noise: float = 1e-3) -> Iterator[ServoStates]:
    """The states of ticks in which the left elbow gives another torque, N m. noise: A from tick to tick."""
    column = op3().joint_map.joints.index("l_el")
    constant, chance = drive_numbers(op3().joint_map.servos[column].model).torque_constant, np.random.default_rng(1)
    while True:
        current = still().current + noise * chance.uniform(-1.0, 1.0, 20)
        current[column] = still().current[column] + torque / constant + noise * chance.uniform(-1.0, 1.0)
        yield replace(still(), current=current)


def look(detector: ContactDetector, states: Iterator[ServoStates], seconds: float) -> float | None:
    """Seconds after which something presses."""
    joints = op3().joint_map.to_radians(still().position)
    for tick in range(round(seconds / DT)):
        detector.look(next(states), joints, standing())
        if detector.pressed is not None:
            return (tick + 1) * DT
    return None


def begun() -> ContactDetector:
    """A detector that has seen OP3 stand for a second."""
    detector = ContactDetector(op3(), dt=DT)
    assert look(detector, pressing(0.0), 2.0 * BEGUN_S) is None
    return detector


def test_arms_and_head_of_a_standing_robot_are_watched_where_a_current_is_measured() -> None:
    assert ContactDetector(op3(), dt=DT).joints == ARMS_AND_HEAD
    assert felt_servos(load_robot("op3", root="fixed")).all(), "of a robot on a stand legs carry nothing"
    assert not felt_servos(load_robot("poppy")).any(), "MX-28 and AX-12A measure none"


def test_the_weight_of_the_arms_is_explained() -> None:
    detector = begun()
    felt = detector.unexplained[[op3().joint_map.joints.index(joint) for joint in ARMS_AND_HEAD]]
    assert np.abs(felt).max() < 0.01
    assert np.isnan(detector.unexplained[op3().joint_map.joints.index("l_knee")])


def test_a_press_beyond_the_bound_is_found_within_two_tenths_and_is_over_when_it_is_gone() -> None:
    detector, bound = begun(), 0.35  # N m: 2.5 x 0.105 of friction, and 2 % of 4.1
    assert look(detector, pressing(0.8 * bound), 3.0) is None
    assert not detector.take_news()
    found = look(detector, pressing(1.5 * bound), 1.0)
    assert found is not None and SUSTAINED_S / 2.0 < found < 0.2
    assert detector.pressed is not None and detector.pressed.joint == "l_el"
    limb = {op3().joint_map.joints[column] for column in np.flatnonzero(detector.pressed.limb)}
    assert limb == {"l_sho_pitch", "l_sho_roll", "l_el"}
    (said,) = detector.take_news()
    assert detector.pressed.text in said
    presses = detector.presses
    assert presses is not None and (presses.times, presses.joint, presses.at) == (1, "l_el", "l_hand")
    assert presses.torque == pytest.approx(1.5 * bound, rel=0.1) and presses.force is not None
    states, joints, ticks = pressing(0.0), op3().joint_map.to_radians(still().position), 0
    goes_on = True
    while goes_on:
        detector.look(next(states), joints, standing())
        ticks, goes_on = ticks + 1, detector.pressed is not None
    assert CLEAR_S < ticks * DT < CLEAR_S + 0.2


def test_a_current_that_does_not_change_is_no_press_and_is_said() -> None:
    detector = begun()
    assert look(detector, pressing(1.0, noise=0.0), 1.0) is None
    (said,) = detector.take_news()
    assert said == STUCK.format("l_el")
    assert look(detector, pressing(1.0, noise=0.0), 1.0) is None and not detector.take_news(), "said once"
    assert look(detector, pressing(1.0), 0.5) is not None, "it measures again"


def test_without_a_current_nothing_presses() -> None:
    detector = begun()
    unknown = replace(still(), current=np.full(20, np.nan))
    assert look(detector, iter(lambda: unknown, None), 1.0) is None
    assert look(detector, pressing(1.0), BEGUN_S + 0.3) is not None


def without(states: Iterator[ServoStates], joint: str) -> Iterator[ServoStates]:
    """The same states without the current of one joint."""
    for one in states:
        current = one.current.copy()
        current[op3().joint_map.joints.index(joint)] = np.nan
        yield replace(one, current=current)


def test_a_current_that_is_not_known_says_nothing_of_its_own_joint_alone() -> None:
    detector = begun()
    assert look(detector, without(pressing(1.0), "l_el"), 1.0) is None
    assert look(detector, without(pressing(1.0), "head_pan"), 1.0) is not None
    joints = op3().joint_map.to_radians(still().position)
    states = without(pressing(1.0), "l_el")
    for _ in range(round(1.0 / DT)):
        detector.look(next(states), joints, standing())
    assert detector.pressed is None, "a press whose current is gone is over"


def test_nothing_is_judged_on_the_way_to_rest() -> None:
    detector, states = begun(), pressing(1.0)
    joints = op3().joint_map.to_radians(still().position)
    for _ in range(round(1.0 / DT)):
        detector.look(next(states), joints, standing(), moves=False)
    assert detector.pressed is None and not detector.take_news()


def test_a_robot_of_few_ticks_is_not_watched() -> None:
    assert load_robot("toddlerbot").profile.safety.rate_hz < SLOWEST_HZ
    assert not felt_servos(load_robot("toddlerbot")).any()


def test_the_way_back_brakes_within_the_limits_and_ends_where_the_limb_was() -> None:
    servos = op3().joint_map
    gate = Gate(servos, dt=DT)
    goal = gate.begin(np.asarray(servos.to_radians(still().position)))
    column = servos.joints.index("l_sho_pitch")
    for tick in range(1, 10):
        target = goal.posture.copy()
        target[column] += 0.5 * 20.0 * DT**2 * (2 * tick - 1)
        passed = gate.check(goal, target)
        assert passed is not None
        goal = passed
    there = goal.posture.copy()
    there[column] -= 0.05
    press = Press("l_sho_pitch", "", np.arange(len(servos)) == column, there)
    path = return_path(press, goal, servos, dt=DT)
    assert path is not None and np.abs(path[-1] - there).max() < 1e-9
    steps = np.diff(np.vstack([goal.posture - goal.displacement, goal.posture, path])[:, column])
    assert np.abs(np.diff(steps)).max() <= servos.max_acceleration[column] * DT**2
    assert np.abs(steps).max() <= servos.max_velocity[column] * DT
    for row in path:  # each posture passes as a target of its own
        passed = gate.check(goal, row)
        assert passed is not None
        goal = passed
    assert return_path(press, goal, servos, dt=DT) is None


# Whole runs with mass.


class Watcher(RunObserver):
    """Keeps states and forces of the wall, N."""

    def __init__(self) -> None:
        self.states, self.forces, self.times = list[RunState](), list[float](), list[float]()
        self.simulation: Simulation

    def see(self, tick: Tick) -> None:
        world, data = self.simulation.world, self.simulation.data
        assert tick.output is not None
        touching = (world.owners[data.contact.geom] == world.FIXTURES).any(axis=1)
        address = data.contact.efc_address[touching]
        self.times.append(tick.given.now)
        self.states.append(tick.output.run_state)
        self.forces.append(float(data.efc_force[address[address >= 0]].sum()))


def run_against(wall: float | None, watcher: Watcher, *, friction: float = 1.0) -> RunResult:
    """OP3 waves and squats; a wall so far ahead, m, is in the simulation alone."""
    box = Box(size=(0.03, 0.5, 0.4))
    scene = None
    if wall is not None:
        wall_ahead = {"shape": {"box": box}, "at": {"pos": (wall, 0.0, 0.35)}}
        scene = Scene.model_validate({"name": "wall", "description": "A wall", "obstacles": {"wall": wall_ahead}})

    def make_bus(robot: RobotBody, clock: Clock) -> ServoBus:
        watcher.simulation = simulation_of(robot, start=posture_ticks(robot), scene=scene)
        for dof in range(watcher.simulation.world.model.nv):
            watcher.simulation.world.model.dof_frictionloss[dof] *= friction
        return physics_bus(watcher.simulation, clock)

    options = RunOptions(robot="op3", bus="physics", playback=Playback(end=4.0))
    with prepare(synthetic_performer, options, clock=VirtualClock(), make_bus=make_bus, goes_to_rest=True) as prepared:
        return prepared.run(observers=[watcher])


@pytest.mark.long
def test_a_hand_that_runs_into_a_wall_is_held_and_gives_way() -> None:
    watcher = Watcher()
    run = run_against(0.25, watcher)
    forces, times = np.array(watcher.forces), np.array(watcher.times)
    touched, held = times[forces > 0.1][0], times[[state is RunState.HOLD for state in watcher.states]][0]
    assert 0.0 < held - touched < 0.2
    assert forces[(times > held + 0.9) & (times < held + 1.0)].max() < 2.0, "it does not press on"
    assert run.tally.presses is not None and run.tally.presses.at == "r_hand"
    assert run.state == "off" and run.stop is None, run.reason
    assert run.record.robot is not None
    felt = run.record.unexplained[:, op3().joint_map.joints.index("r_sho_pitch")]
    assert np.nanmax(np.abs(felt)) > 1.0


@pytest.mark.long
@pytest.mark.parametrize("friction", [0.7, 1.3])
def test_without_a_wall_nothing_is_held(friction: float) -> None:
    watcher = Watcher()
    run = run_against(None, watcher, friction=friction)
    assert RunState.HOLD not in watcher.states and run.tally.presses is None
