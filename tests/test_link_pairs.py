"""Which pairs of geoms are compared, and why the others are not."""

import mujoco
import numpy as np

from retarget.metrics.link_pairs import LeftOut, compared_pairs

CHAIN = """
<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body name="base"><freejoint/><geom size="0.01"/><geom size="0.01" pos="0.02 0 0"/>
    <body name="arm" pos="0.1 0 0"><joint/><geom size="0.01"/>
      <body name="plate" pos="0.1 0 0"><geom size="0.01"/>
        <body name="hand" pos="0.1 0 0"><joint axis="1 0 0"/><geom size="0.01"/></body>
      </body>
    </body>
    <body name="leg" pos="0 0 -0.1"><joint/><geom size="0.01"/></body>
    <body name="tail" pos="0.015 0 0"><joint/><geom size="0.01"/>
      <body name="tip" pos="0 0 0"><joint/><geom size="0.012"/></body>
    </body>
  </body>
</worldbody><contact><exclude body1="hand" body2="leg"/></contact></mujoco>"""


def test_every_pair_is_compared_or_told() -> None:
    model = mujoco.MjModel.from_xml_string(CHAIN)
    geoms = np.flatnonzero(model.geom_bodyid > 0)
    links = model.geom_bodyid[geoms].astype(np.int64)
    pairs, left_out = compared_pairs(model, links, geoms, neutral=model.qpos0, ignored=[("tip", "leg")])
    named = {frozenset(str(model.body(int(links[side])).name) for side in pair) for pair in pairs}
    near = "neighbours along the body"
    assert set(left_out) == {
        LeftOut("base", "arm", near),
        LeftOut("base", "leg", near),
        LeftOut("base", "tail", near),
        LeftOut("arm", "plate", near),
        LeftOut("arm", "hand", near),  # the plate is one with the arm
        LeftOut("base", "plate", near),
        LeftOut("plate", "hand", near),
        LeftOut("tail", "tip", near),
        LeftOut("hand", "leg", "excluded by the body's file"),
        LeftOut("leg", "tip", "ignored by the profile"),
        LeftOut("base", "tip", "touch in the neutral posture"),
    }
    told = {frozenset((pair.first, pair.second)) for pair in left_out}
    names = [str(model.body(link).name) for link in sorted(set(links.tolist()))]
    every = {frozenset((a, b)) for k, a in enumerate(names) for b in names[k + 1 :]}
    assert named | told == every
    assert not named & told
