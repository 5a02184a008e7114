"""Real motion and real bytes raise no alarm, but where they really jump."""

from pathlib import Path

import numpy as np
import pytest

from retarget.live.sensor_validity import SensorValidity, ValidityLimits, ValidityState
from retarget.sources.open import open_source
from retarget.sources.raw_record import RawReader
from retarget.sources.vmc import VmcDecoder
from validity_rig import judge, recorded


@pytest.mark.parametrize("rate", [60.0, 120.0])
@pytest.mark.parametrize("name", ["cmu_asfamc/02_06.amc", "cmu_asfamc/05_13.amc", "cmu_bvh_hahne/49_06.bvh"])
def test_real_motion_raises_no_alarm(name: str, rate: float, shared: Path) -> None:
    frames = open_source(shared / "mocap" / name).cut(0.1, 5.0)  # a BVH begins with one frame of its rest pose
    for metres in (0.001, 0.005):
        judged = judge(recorded(frames, rate, metres=metres))
        assert not judged.alarms() and not judged.validity.refused.count


@pytest.mark.long
@pytest.mark.parametrize("rate", [30.0, 60.0, 100.0, 120.0, 240.0])
def test_no_recording_raises_an_alarm(rate: float, shared: Path) -> None:
    folders = ("cmu_asfamc/*.amc", "cmu_bvh_hahne/*.bvh", "cmu_bvh_daz/*.bvh")
    for path in sorted(path for folder in folders for path in (shared / "mocap").glob(folder)):
        frames = open_source(path).cut(0.1, 28.0 if path.stem == "01_07" else None)
        judged = judge(recorded(frames, rate, metres=0.003))
        assert not judged.alarms() and not judged.validity.refused.count, path.name


def test_the_real_jump_of_01_07_is_found(shared: Path) -> None:
    """Its markers were lost for a while, and frames 3363 and 3364 are 0.65 m apart."""
    frames = open_source(shared / "mocap" / "cmu_asfamc" / "01_07.amc").cut(27.0, 30.0)
    judged = judge(recorded(frames, 120.0, metres=0.001))
    assert judged.alarms() == {ValidityState.JUMPED}
    assert judged.usable[:123].all() and not judged.usable[124, frames.index("l_toe")]


def test_real_slimevr_bytes_raise_no_alarm(shared: Path) -> None:
    """They were scripted, without noise: what rests there repeats itself to the bit while one arm moves. Before the
    headset is received, the head is at the origin; then everything goes up by 1.5 m, which is a jump."""
    decoder, validity, alarms = VmcDecoder(), SensorValidity(()), []
    for record in RawReader(shared / "streams" / "slimevr" / "full12_vmc_50hz.udprec.gz"):
        for frame in decoder.decode(record.payload):
            picked = [i for i, name in enumerate(frame.names) if name.startswith("human://")]
            names = tuple(frame.names[i] for i in picked)
            if not validity.names:
                validity = SensorValidity(names, ValidityLimits(low=-3.0))
            assert frame.stamp is not None and names == validity.names and len(names) == 11
            validity.take(
                np.arange(len(picked)),
                frame.stamp,
                position=frame.position[picked],
                orientation=frame.orientation[picked],
                tracked=frame.tracked[picked],
            )
            alarms.append((frame.stamp, set(validity.judge(frame.stamp + 0.01).tolist())))
    assert {state for stamp, states in alarms for state in states if stamp < 1.1} == {0, ValidityState.JUMPED}
    assert {state for stamp, states in alarms for state in states if stamp >= 1.1} == {0}
    assert alarms[-1][0] > 15.0
