"""The plug-in as LeRobot finds and runs it: registration, options, factory and loop with a stand-in for PyTorch, and
LeRobot's own programs where the real one is there (`make lerobot`)."""

import json
import os
import subprocess
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PYTHON = os.environ.get("RETARGET_LEROBOT_PYTHON") or str(ROOT / ".venv-lerobot/bin/python")
"""A Python, 3.12 or newer, with LeRobot and the plug-in."""
TORCH = ROOT / "tests/support/stand_in_torch"
MISSING = "no Python 3.12 with LeRobot: `make lerobot`, or name one in RETARGET_LEROBOT_PYTHON"
DEVICES = ("--robot.type=retarget_humanoid", "--teleop.type=retarget_performer")


def has(module: str) -> bool:
    find = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({module!r}) is None)"
    try:
        return subprocess.run([PYTHON, "-c", find], check=False, capture_output=True, timeout=60).returncode == 0
    except OSError:
        return False


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    """Variables of a process that has LeRobot, and PyTorch or its stand-in."""
    if not has("lerobot") or not has("lerobot_robot_retarget"):
        pytest.skip(MISSING)
    path = [str(ROOT), *([] if has("torch") else [str(TORCH)])]
    home = str(tmp_path_factory.mktemp("lerobot"))
    return os.environ | {"PYTHONPATH": os.pathsep.join(path), "HF_LEROBOT_HOME": home, "HF_HUB_OFFLINE": "1"}


def by_hand(environment: Mapping[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [PYTHON, str(ROOT / "tests/support/lerobot_by_hand.py"), *DEVICES, *arguments]
    return subprocess.run(command, env=environment, check=False, capture_output=True, text=True, timeout=120)


def test_the_name_is_found_by_lerobot() -> None:
    """LeRobot imports what literally begins so."""
    plugin = ROOT / "plugins/lerobot_robot_retarget"
    about = tomllib.loads((plugin / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert about["name"] == "lerobot_robot_retarget" == plugin.name
    ours = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert about["version"] == ours["version"]
    assert not [name for name in ours["dependencies"] if "lerobot" in name]


def test_a_loop_by_hand(environment: Mapping[str, str], tmp_path: Path) -> None:
    socket = tmp_path / "socket"
    options = ("--robot.stale_ms=300", f"--robot.control_socket={socket}", "--teleop.delay_s=0", "--seconds=5")
    done = by_hand(environment, *options)
    assert done.returncode == 0, done.stderr
    assert not socket.exists()
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert found["types"] == ["retarget_humanoid", "retarget_performer"] and found["cameras"] == {}
    assert found["not_connected"] and found["kinds"] == ["float"]
    assert found["robot_actions"] == found["teleop_actions"] == found["action"] == found["driven"]
    assert len(found["action"]) == 20 and all(name.endswith(".pos") for name in found["action"])
    assert found["observation"] == found["robot_observations"]
    assert found["observation"][20:] == [name.replace(".pos", ".goal") for name in found["action"]]
    assert found["off"] < 0.5  # rad: it follows


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("--robot.bus=mok", "mok"),
        ("--robot.profile=op33", "op3"),
        ("--teleop.source=nothing.bvh", "nothing.bvh"),
        ("--teleop.dead_man=a", "dead_man"),
    ],
)
@pytest.mark.long
def test_a_bad_option_is_refused_by_our_message(environment: Mapping[str, str], argument: str, said: str) -> None:
    done = by_hand(environment, argument)
    assert done.returncode != 0 and said in done.stderr.splitlines()[-1], done.stderr


@pytest.fixture
def programs(environment: Mapping[str, str]) -> Path:
    """The folder of LeRobot's programs."""
    if not has("torch") or not has("datasets"):
        pytest.skip("LeRobot's programs need PyTorch and the extra core_scripts: `make lerobot`")
    return Path(PYTHON).parent


def program(folder: Path, environment: Mapping[str, str], name: str, *arguments: str) -> None:
    command = [str(folder / name), *arguments]
    done = subprocess.run(command, env=environment, check=False, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.long
def test_the_real_programs_teleoperate_record_and_replay(
    programs: Path, environment: Mapping[str, str], tmp_path: Path
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="reads the data set: the extra 'record'")
    program(programs, environment, "lerobot-teleoperate", *DEVICES, "--fps=30", "--teleop_time_s=5")
    place = tmp_path / "set"
    of_set = ("--dataset.repo_id=me/wave", f"--dataset.root={place}")
    recording = ("--dataset.single_task=Wave.", "--dataset.num_episodes=2", "--dataset.episode_time_s=2")
    quiet = ("--dataset.reset_time_s=1", "--dataset.fps=30", "--dataset.push_to_hub=false", "--dataset.no_stamp=true")
    program(programs, environment, "lerobot-record", *DEVICES, *of_set, *recording, *quiet, "--play_sounds=false")
    info = json.loads((place / "meta/info.json").read_text())
    assert info["total_episodes"] == 2 and info["fps"] == 30 and info["robot_type"] == "retarget_humanoid"
    names = info["features"]["action"]["names"]
    assert len(names) == 20 and len(info["features"]["observation.state"]["names"]) == 40
    frames = parquet.read_table(place / "data/chunk-000/file-000.parquet")
    assert frames.num_rows == info["total_frames"] > 80
    episode = ("--dataset.episode=1", "--play_sounds=false")
    program(programs, environment, "lerobot-replay", DEVICES[0], *of_set, *episode)
