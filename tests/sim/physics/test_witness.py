"""From the witness of a simulation to the numbers, the messages and the picture of a run."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hardware.arrays import FloatArray
from messages import shows
from physics_rig import PhysicsRig, op3, standing
from retarget.ik.support_polygon import plant, support_distance
from retarget.pictures.animation import animation_of
from retarget.pictures.page import page_html
from retarget.pictures.plots import plot_pressure
from retarget.report.findings import findings, remarks
from retarget.report.measure import measure
from retarget.report.motion_metrics import PhysicsReport, physics_report
from retarget.run.run_result import Fallen, PhysicsRun, RunResult
from rig import Rig, person, result, short_clip
from sim.buses import simulation_of
from sim.physics.ground import sole_corners
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Perturbation, Push
from sim.physics.state import PhysicsState
from sim.physics.witness import (
    BLOCK_ROWS,
    SLIP_RESOLUTION_M,
    FallWatch,
    PhysicsLog,
    Witness,
    physics_run,
    zmp_margins,
)


@pytest.fixture(scope="module")
def bare() -> RunResult:
    rig, human, clip = Rig(np.zeros((51, 20))), person(), short_clip()
    ending = rig.loop(clip).run()
    return result(ending, clip, human, rig.robot)


@pytest.fixture(scope="module")
def pushed() -> PhysicsRun:
    push = Push((12.0, 0.0, 0.0), 1.2, 0.2)
    rig = PhysicsRig(perturbation=Perturbation(pushes=(push,)))
    rig.arm()
    rig.run(2.2)
    rig.bus.close()
    return physics_run(rig.bus.witness, begun=-0.5, seed=7, perturbations=("push",))


def test_the_report_has_what_the_simulation_saw(bare: RunResult, pushed: PhysicsRun) -> None:
    report, fall = measure(replace(bare, physics=pushed)), pushed.fall
    assert report.fallen is True and report.physics is not None and fall is not None
    physics = report.physics
    assert physics.fallen and physics.fallen_at_s == fall.time and physics.how == fall.how
    assert (physics.mount, physics.seed, physics.perturbations) == ("floor", 7, ("push",))
    assert set(physics.foot_slip_mm) == {*op3().profile.feet, "total"}
    feet = sum(slip for foot, slip in physics.foot_slip_mm.items() if foot != "total")
    assert physics.foot_slip_mm["total"] == pytest.approx(feet)
    assert set(physics.torque_nm) == set(physics.temperature_c) == set(op3().joint_map.joints)
    knee = physics.torque_nm["l_knee"]
    assert 0.0 < knee.p95 <= knee.max == np.abs(pushed.torque).max(axis=0)[op3().joint_map.joints.index("l_knee")]
    before = pushed.time <= fall.time
    assert physics.min_zmp_margin_mm == pytest.approx(1e3 * np.nanmin(pushed.margin[before]))
    assert physics.sole_tilt_max_deg > 5.0 and (physics.realtime_factor or 0.0) > 0.0
    shows(physics.heat_model)


def test_ratios_and_travel_are_those_of_the_simulated_body(bare: RunResult, pushed: PhysicsRun) -> None:
    """What was sent stands still; the body was pushed over."""
    still, fell = measure(bare), measure(replace(bare, physics=pushed))
    assert (still.travelled_m.robot, still.turned_deg.robot) == pytest.approx((0.0, 0.0), abs=1e-6)
    q = replace(bare, physics=pushed).moved_q
    assert q is not None and bare.record.robot is not None and bare.moved_q is bare.record.robot.q
    tick = int(np.argmin(np.abs(pushed.time - bare.record.time[20])))
    np.testing.assert_allclose(q[20, :7], pushed.body[tick, :7], atol=2e-3)
    assert still.likeness_deg is not None and fell.likeness_deg is not None and still.trunk_lean_deg is not None
    assert fell.likeness_deg["thighs"].max > still.likeness_deg["thighs"].max
    assert fell.trunk_lean_deg is not None and fell.trunk_lean_deg.max > still.trunk_lean_deg.max
    assert (fell.travelled_m.robot or 0.0) > 0.0


def test_the_page_shows_the_simulated_body_and_marks_what_is_planned(bare: RunResult, pushed: PhysicsRun) -> None:
    fell = replace(bare, physics=pushed)
    still, moved = animation_of(bare), animation_of(fell)
    assert still is not None and moved is not None
    assert still["robot"]["poses"] != moved["robot"]["poses"] and still["robot"]["marks"] == moved["robot"]["marks"]
    assert still["ground"]["com"] != moved["ground"]["com"]
    page = page_html(fell, measure(fell), figures={})
    for html in (page, page_html(bare, measure(bare), figures={})):
        (caption,) = re.findall(r"<figcaption><b>op3</b><span>(.*?)</span>", html)
        shows(caption)
    planned = {one.name for one in findings(fell, measure(fell)) if one.name.endswith(", as planned")}
    assert {"centre of mass, as planned", "its own links, as planned"} <= planned


PHYSICS = ("physics", "at rest", "pressure", "torque", "heat", "contacts", "simulation")


def facts(bare: RunResult, physics: PhysicsRun) -> tuple[PhysicsReport, dict[str, str]]:
    run = replace(bare, physics=physics)
    report = physics_report(run)
    assert report is not None
    return report, {one.name: one.measured for one in findings(run, measure(run)) if one.name in PHYSICS}


def test_a_person_reads_and_sees_when_and_how_it_fell(bare: RunResult, pushed: PhysicsRun) -> None:
    report, lines = facts(bare, pushed)
    assert lines["physics"].startswith(f"fallen at {report.fallen_at_s:.2f} s: {report.how}")
    shows(lines["physics"], 7)
    for name in ("heat", "torque", "simulation"):
        shows(lines[name])
    shows(lines)
    figure = plot_pressure(replace(bare, physics=pushed))
    assert figure is not None
    above, time = figure.axes
    assert any("fallen" in text.get_text() for text in time.texts)
    path = next(line for line in above.lines if line.get_label() == "centre of mass")
    assert np.abs(np.asarray(path.get_xdata())).max() < 100.0  # until the fall, not after it


def test_a_robot_that_did_not_stay_at_rest_breaks_a_limit_on_the_page_too(bare: RunResult, pushed: PhysicsRun) -> None:
    toppled = replace(bare, physics=replace(pushed, toppled=Fallen(9.0, "the pelvis is sideways")))
    report = measure(toppled)
    (found,) = [one for one in findings(toppled, report) if one.name == "at rest"]
    assert found.kept is False and any("sideways" in line for line in remarks(toppled, report, (), room=6))
    assert "sideways" in page_html(toppled, report, figures={})


def test_a_robot_on_a_stand_has_no_pressure_and_never_falls(bare: RunResult) -> None:
    rig = PhysicsRig(mount=Mount(Support.STAND))
    rig.arm()
    rig.run(0.1)
    bolted = physics_run(rig.bus.witness)
    report, lines = facts(bare, bolted)
    assert not report.fallen and report.min_zmp_margin_mm is None and "pressure" not in lines
    assert lines["physics"] == "on a stand" and bolted.least_margin is None and bolted.slip.sum() == 0.0
    assert plot_pressure(replace(bare, physics=bolted)) is None
    rig.bus.close()
    assert rig.bus.witness.fall is None


def test_a_standing_robot_has_the_margin_of_its_centre_of_mass() -> None:
    witness = settled().bus.witness
    summary = physics_run(witness)
    margins = zmp_margins(op3(), witness.log, least_load=1.0)
    assert np.isnan(margins[0]) and len(margins) == witness.log.rows  # the hand
    edges = plant(op3(), op3().profile.postures.stand).edges(0.0)
    assert margins[-1] == pytest.approx(float(support_distance(witness.state.com, edges)), abs=4e-3)
    assert summary.least_margin is not None and 0.02 < summary.least_margin <= margins[-1] + 1e-3
    assert summary.fall is None and summary.slip.sum() < 5e-4 and summary.tilt < 0.01
    assert np.abs(summary.torque).max(axis=0)[op3().joint_map.joints.index("l_knee")] > 0.3
    assert summary.hottest.min() >= 25.0 and summary.contacts[0] == 0


def test_nothing_is_logged_before_torque() -> None:
    simulation = simulation_of(op3(), start=standing())
    witness = Witness(simulation)
    simulation.advance(1.0)
    witness.look()
    assert witness.log.rows == 0 and witness.state.time == 1.0
    simulation.switch(np.ones(20, dtype=np.bool_))
    simulation.advance(1.1)
    witness.look()
    assert witness.log.rows == 1


def test_a_robot_at_rest_that_cannot_stay_topples_and_that_is_no_fall() -> None:
    postures = op3().profile.postures.model_copy(update={"rest": op3().profile.postures.stand})
    robot = replace(op3(), profile=op3().profile.model_copy(update={"postures": postures}))
    simulation = simulation_of(robot, start=standing())
    witness = Witness(simulation)
    for on in (True, False):
        simulation.switch(np.full(20, on))
        witness.switched(on)
        simulation.advance(simulation.time + 1.0 * on)
    witness.see_it_out()
    assert witness.at_rest and witness.fall is None
    assert witness.toppled is not None and not witness.toppled.powered


# When a robot has fallen, and when it only sits.

STANDING = PhysicsRig().bus.witness.state
LOWEST = FallWatch(op3()).lowest + 0.0285  # m; the pelvis frame is 28.5 mm below the root
AT_REST = op3().posture(op3().profile.postures.rest)


def low(height: float) -> FloatArray:
    """The standing root at another height, m."""
    return np.array([*STANDING.root[:2], height, *STANDING.root[3:]])


@pytest.mark.parametrize(
    ("change", "fallen"),
    [
        ({}, False),
        ({"tilt": np.radians([28.0, 28.0])}, False),
        ({"tilt": np.radians([32.0, 35.0])}, True),
        ({"tilt": np.radians([0.0, 80.0])}, False),  # a flat sole carries, however low the torso bends
        ({"root": low(LOWEST + 1e-3)}, False),
        ({"root": low(LOWEST - 1e-3)}, True),
        ({"touching": "l_shin"}, True),
        ({"touching": "l_shin", "q": AT_REST}, False),
    ],
)
def test_a_tilt_a_low_root_or_a_touching_link_is_a_fall_but_not_at_rest(change: dict[str, Any], fallen: bool) -> None:
    how = FallWatch(op3()).look(replace(STANDING, **change))
    assert (how is not None) is fallen
    if how is not None:
        shows(how)
    assert 0.06 < LOWEST - 0.0285 < 0.13


CORNERS = np.array([[0.06, 0.04], [-0.06, 0.04], [-0.06, -0.04], [0.06, -0.04]])
"""Of a sole, m."""
BESIDE = np.array([0.0, 0.05])
"""From the middle to the left sole, m."""


def log() -> PhysicsLog:
    return PhysicsLog(
        servos=20, soles=2, corners=[0] * 4 + [1] * 4, nq=STANDING.q.size, loaded=lambda load: np.asarray(load > 1.0)
    )


def at(x: float, load: tuple[float, float] = (15.0, 15.0)) -> PhysicsState:
    """Both soles x m ahead, their load shared by their corners."""
    corners = CORNERS + np.array([x, 0.0])
    corners = np.concatenate([corners + BESIDE, corners - BESIDE])
    return replace(STANDING, corner=corners, pressed=0.25 * np.repeat(load, 4), load=np.array(load), tilt=np.zeros(2))


def test_slip_is_the_path_of_a_sole_that_carries_to_and_fro_or_creeps_but_no_tremble() -> None:
    one, two = log(), log()
    for x in np.linspace(0.0, 0.01, 101):
        one.add(at(float(x), load=(15.0, 0.0)))
    for x in (*np.linspace(0.0, 0.01, 51), *np.linspace(0.01, 0.0, 51)):
        two.add(at(float(x)))
    assert one.slip_m.tolist() == pytest.approx([0.01, 0.0], abs=2 * SLIP_RESOLUTION_M)
    assert two.slip_m.tolist() == pytest.approx([0.02, 0.02], abs=4 * SLIP_RESOLUTION_M)
    creeping, trembling = log(), log()
    for tick in range(1000):
        creeping.add(at(1e-5 * tick))
        trembling.add(at(4e-5 * (-1) ** tick))
    assert creeping.slip_m[0] == pytest.approx(0.01, rel=0.03)
    assert trembling.slip_m[0] == 0.0


def test_rows_hold_what_was_added_however_many() -> None:
    one = log()
    for tick in range(BLOCK_ROWS + 3):
        one.add(replace(STANDING, time=float(tick)))
    assert one.rows == BLOCK_ROWS + 3
    assert one.column("time").tolist() == [float(tick) for tick in range(BLOCK_ROWS + 3)]
    assert one.column("q")[-1] == pytest.approx(STANDING.q, abs=1e-6)
    assert one.column("sole").shape == (one.rows, 2, 3)
    assert one.column("sole")[7] == pytest.approx(STANDING.sole, abs=1e-6)
    assert one.column("torque").shape == (one.rows, 20)
    empty = log()
    assert [empty.column(name).shape for name in ("time", "torque", "sole")] == [(0,), (0, 20), (0, 2, 3)]


# States: what contacts and ground truth say of a robot that stands, hangs and is pushed.


def settled(perturbation: Perturbation | None = None) -> PhysicsRig:
    rig = PhysicsRig(perturbation=perturbation)
    rig.arm()
    rig.run(1.5)
    return rig


def test_a_standing_robot_bears_on_its_corners_below_its_mass_and_a_lying_one_touches_the_floor() -> None:
    rig = settled()
    state = rig.bus.witness.state
    assert state.zmp.tolist() == pytest.approx(state.com[:2].tolist(), abs=1.5e-3)
    assert state.com[2] == pytest.approx(0.257, abs=0.005)
    assert state.tilt.max() < 2e-3 and not state.touching and not state.fixture_contacts
    assert state.sole[:, 2].tolist() == pytest.approx([0.0, 0.0], abs=5e-4)
    soles = np.array(rig.bus.witness._reader.corner_soles)
    assert soles.tolist() == [0] * 6 + [1] * 6
    for sole, foot in enumerate(op3().profile.feet.values()):
        corners = state.corner[soles == sole] - state.sole[sole, :2]
        outline = sole_corners(np.array(foot.polygon))
        assert np.abs(np.sort(corners, axis=0) - np.sort(outline, axis=0)).max() < 2e-3
        assert state.pressed[soles == sole].sum() == pytest.approx(state.load[sole])
    assert (state.pressed >= 0.0).all() and state.load.sum() == pytest.approx(30.9, rel=0.02)
    rig.bus.torque(False)
    rig.run(1.5)
    assert rig.bus.witness.state.touching in op3().body.body_names


def test_pushed_the_pressure_moves_against_and_a_foot_that_rocks_on_its_edge_does_not_slip() -> None:
    rig = settled(Perturbation(pushes=(Push((4.0, 0.0, 0.0), 1.5, 0.1),)))
    before = rig.bus.witness.state.zmp[0]
    rig.run(0.1)
    assert rig.bus.witness.state.zmp[0] > before + 0.005  # a push forward loads the toes
    assert rig.bus.witness.log.column("com")[-1, 0] > rig.bus.witness.log.column("com")[-12, 0]
    rig = settled(Perturbation(friction=1.5, pushes=(Push((0.0, 5.5, 0.0), 1.5, 0.12, "neck"),)))
    rig.run(0.4)
    log = rig.bus.witness.log
    assert log.worst_tilt > np.radians(1.0)
    assert log.slip_m.max() < 3e-4
    assert log.column("sole")[:, :, 2].max() > 5e-4  # [m] a foot came up
