"""What a command refuses: one message without a traceback, exit code 2, and nothing is left. The words are pinned."""

import shlex
from pathlib import Path

import pytest

from command_line import Typed
from messages import shows
from unknown_robots import small_bust

FILES = {
    "two.xml": """<mujoco><worldbody><body name="a"><geom size="0.1"/>
        <body name="b"><joint range="-9 9"/><geom size="0.1"/></body></body></worldbody></mujoco>""",
    "bust.urdf": small_bust(),
    "faults.yaml": "faults: [{fault: missing, ids: [77]}]\n",
    "not.mcap": "no recording",
    "empty.yaml": "",
}
"""In the folder in which the commands are typed."""

RUN = "run --robot op3 --source sample --save s.npz"
LIVE = "run --robot human --source json://127.0.0.1:14150"
REPLAYED = "run --robot human --source replay://nowhere.raw"
WALKS = "run --robot op3 --source json://127.0.0.1:14150"
WALKED = "run --robot op3 --source replay://nowhere.raw"
EMULATE = "emulate --robot op3 --link link"
FIT = "fit-observers op3"

TYPED = [
    "inspekt",
    "robots --colour",
    "check",
    "run",
    "run --robot op4 --source sample",
    "run --robot op3 --source nothing.amc",
    f"{RUN} --bus mok",
    f"{RUN} --bus /dev/no-such-port",
    f"{RUN} --bus /dev/no-such-port --no-gate",
    f"{RUN} --bus mock --perturb push",
    f"{RUN} --bus physics --mount wall",
    f"{RUN} --bus physics --mount gantry",
    f"{RUN} --faults faults.yaml",
    f"{RUN} --performer fiv",
    f"{RUN} --parts lower",
    f"{RUN} --priorities serv",
    f"{RUN} --speed 0",
    f"{RUN} --speed -1",
    f"{RUN} --speed nan",
    f"{RUN} --speed fast",
    f"{RUN} --n-ik 0",
    f"{RUN} --rate 1e9",
    f"{RUN} --rate 0",
    f"{RUN} --start 2 --end 1",
    f"{RUN} --start 1000",
    f"{RUN} --unit furlong",
    f"{RUN} --report nowhere/r.json",
    f"{RUN} --report r.html",
    f"{RUN} --plots --animate x.webp",
    "run --robot op3 --source sample --save s.csv",
    f"{RUN} --sing",
    f"{RUN} --scene s.yaml",
    f"{RUN} --realtime 0",
    f"{RUN} --dead-man b --control-socket",
    f"{RUN} --steps walk --stick keys",
    f"{RUN} --person anna --check-sides",
    "run --robot human --source sample --parts upper",
    "run --robot human --source sample --no-gate",
    "run --robot human --source sample --bus ./op3-port",
    "run --robot human --source sample --bus emulator",
    "run --robot human --source sample --bus profile",
    f"{REPLAYED} --recalibrate",
    f"{REPLAYED} --check-sides --yes",
    f"{REPLAYED} --speed 2",
    f"{LIVE} --realtime 0",
    f"{LIVE} --dead-man b",
    f"{LIVE} --stick keys",
    f"{WALKS} --steps planted --stick keys",
    f"{LIVE.replace('human', 'poppy')} --steps walk --stick keys",
    f"{WALKS} --steps walk --stick keys",
    f"{WALKS} --steps walk --stick joy",
    f"{WALKS} --steps walk --stick page",
    f"{WALKS} --steps walk --stick gamepad:/dev/null",
    f"{WALKED} --steps walk --stick keys",
    f"{LIVE} --control-socket /nowhere/x",
    f"{LIVE} --start 3",
    "emulate --robot op4 --link link",
    "emulate --robot op3 --link two.xml",
    "emulate --robot op3 --link nowhere/link",
    f"{EMULATE} --faults nothing.yaml",
    f"{EMULATE} --faults faults.yaml",
    f"{EMULATE} --for 0",
    f"{EMULATE} --for nan",
    f"{EMULATE} --seed -1",
    f"{EMULATE} --boot -0.1",
    f"{EMULATE} --boot inf",
    f"{EMULATE} --boot nan",
    f"{EMULATE} --gaps fill",
    f"{EMULATE} --watchdog-fed-by none",
    "demo two.xml",
    "demo new --robot op4",
    "demo --bus profile",
    "doctor vmc:39539",
    "doctor nope://:1",
    "doctor vmc://:39539 --robot op3",
    "doctor vmc://:39539 --seconds 0",
    "doctor vmc://:39539 --seconds nan",
    "doctor vmc://:39539 --performer unknown_name",
    "doctor --performer five",
    "doctor --robot unknown_name",
    "doctor replay://nowhere.raw",
    "fit-observers opp3",
    "fit-observers human",
    "fit-observers gone.xml",
    "fit-observers two.xml --out two.xml",
    f"{FIT} --influence 0",
    f"{FIT} --influence nan",
    f"{FIT} --margin 0.03",
    f"{FIT} --out no/such/folder.yaml",
    "import bust.urdf --out new --servo XL999",
    "import bust.urdf --out new --links bust.urdf",
    "inspect two.xml",
    "inspect sample --rate 0",
    "inspect sample --unit furlong",
    "replay nothing.mcap",
    "replay not.mcap",
    "replay not.mcap --goals",
    "replay not.mcap --bus mock",
    "replay not.mcap --speed 0.5",
    "replay not.mcap --goals --bus mock --save x.npz",
    "view not.mcap",
    "view nothing.npz",
    "export nothing.npz --to csv",
    "export not.mcap --to cvs",
    "stop nowhere",
]


@pytest.mark.parametrize("typed", TYPED)
def test_it_is_one_message_and_nothing_is_left(
    typed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Typed
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    shows(refused(*shlex.split(typed)))
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES
