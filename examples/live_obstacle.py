"""A tracked ball comes at a reaching performer's right hand; the scene gets its position tick by tick."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.model.human import build_human
from retarget.model.scene_state import SceneState
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.schema.scene import load_scene
from sim.performer import synthetic_performer

BALL = "name: ball\ndescription: tracked\nobstacles:\n  ball: {shape: {sphere: {radius: 0.1}}, at: {pos: [0, 0, -9]}}\n"
DT = 1.0 / 120.0


def main() -> None:
    """Print how far a wrist went into the ball as it was sensed, and how near the human came to it, which avoids it."""
    with TemporaryDirectory() as folder:
        (path := Path(folder, "ball.yaml")).write_text(BALL, encoding="utf-8")
        scene = SceneState(load_scene(path))
    human, hand = build_human(calibrate(frames := synthetic_performer())), frames.sample(2.5).position[2]
    stage = Reconstructor(human, load_priorities("human"), load_performer("five"), scene=scene)
    stage.start(frames.sample(0.0))
    nearest = sensed = np.inf
    for tick, place in enumerate(np.linspace(hand + np.array([0.5, 0.0, 0.0]), hand, 300)):
        scene.live("ball").update(place, (1.0, 0.0, 0.0, 0.0), time=tick * DT)
        stage.step(sample := frames.sample(tick * DT), DT)
        nearest = min(nearest, stage.hierarchy.solver.clearance[1])
        sensed = min(sensed, float(np.linalg.norm(sample.position[2] - place)) - 0.1)
    print(f"the sensed wrist went {-1e3 * sensed:.1f} mm into the ball; the body kept {1e3 * nearest:.1f} mm off it")


if __name__ == "__main__":
    main()
