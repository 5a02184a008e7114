"""The benchmark compares like with like: one body in two formats, motions in reach, errors measured once."""

from functools import partial

import numpy as np
import pytest

from benchmarks.bodies import BenchBody, bench_human, bench_op3
from benchmarks.measure import OURS, run, show_sides
from benchmarks.motion import RATE, crouch_and_reach
from benchmarks.ours import Ours
from benchmarks.urdf import write_urdf
from retarget.model.body import load_body_text


@pytest.fixture(scope="module", params=[bench_human, bench_op3], ids=["human", "op3"])
def body(request: pytest.FixtureRequest) -> BenchBody:
    made: BenchBody = request.param()
    return made


def test_the_peers_body_moves_as_ours(body: BenchBody) -> None:
    model = load_body_text(write_urdf(body), source="urdf", root="free")
    rng = np.random.default_rng(7)
    ours, theirs = body.model.solver_body(), model.solver_body()
    for _ in range(5):
        q, q_urdf = body.model.qpos0.copy(), model.qpos0.copy()
        q[:3], q[3:7] = rng.normal(size=3), rng.normal(size=4)
        q[3:7] /= np.linalg.norm(q[3:7])
        q_urdf[:7] = q[:7]
        for name in model.joint_names[1:]:
            angle = rng.uniform(-1.0, 1.0)
            q[body.model.joint_qpos[body.model.joint_index(name)]] = angle
            q_urdf[model.joint_qpos[model.joint_index(name)]] = angle
        expected = ours.points(q[None], body.links(), body.offsets())[0]
        links = [model.body_index(f"bench_{point.name}") for point in body.points]
        assert theirs.points(q_urdf[None], links, np.zeros((5, 3)))[0] == pytest.approx(expected, abs=1e-9)
        assert theirs.centre_of_mass(q_urdf[None]) == pytest.approx(ours.centre_of_mass(q[None]), abs=1e-6)


def test_the_easy_motion_is_in_reach_and_in_speed(body: BenchBody) -> None:
    peak = body.attractor.copy()
    for joint, angle in body.swing.items():
        index = body.model.joint_index(joint)
        peak[body.model.joint_qpos[index]] += angle
    assert np.all((peak[7:] >= body.model.lower[6:]) & (peak[7:] <= body.model.upper[6:]))
    motion = crouch_and_reach(body, 240)
    speed = np.linalg.norm(np.diff(motion.points, axis=0), axis=2) * RATE
    assert 0.05 < speed.max() < 3.0
    assert np.ptp(motion.com[:, 2]) > 0.01


def test_a_short_run_reports_every_side(body: BenchBody, capsys: pytest.CaptureFixture[str]) -> None:
    outcomes = run(body, crouch_and_reach(body, 40), [Ours, partial(Ours, name="other")])
    assert [outcome.side for outcome in outcomes] == [OURS, "other"]
    for outcome in outcomes:
        assert outcome.com_mm < 1.0 and outcome.ankles_mm < 1.0
        assert outcome.speed <= 1.0 + 1e-9 and outcome.beyond_limits_rad < 1e-12
    show_sides("frames", outcomes, docs=False)
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert len(rows) == 3 and len({line.count("|") for line in rows}) == 1 and "| other |" in rows[0]
