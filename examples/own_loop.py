"""Your own loop at 100 Hz, transport (JSON over UDP) and bus: joint goals from `retarget.Pipeline`."""

import json
import socket

import numpy as np

from hardware.clock import VirtualClock
from retarget import Pipeline, SensorSample
from sim.performer import synthetic_performer

DT, SECONDS, ARM_MM, SENSORS = 0.01, 8.0, 230, ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")


def main() -> None:
    """Follow a performer who stands for 4 s, then crouches; print how far the hands are off."""
    clock, frames, bus = VirtualClock(), synthetic_performer().select(SENSORS), dict[str, float]()  # MonotonicClock
    pipeline, off = Pipeline("op3", performer="five", rate_hz=1 / DT), list[float]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inbox:
        inbox.bind(("127.0.0.1", 0))
        inbox.settimeout(DT)
        for tick in range(round(SECONDS / DT)):
            seen = frames.sample(max(0.0, tick * DT - 4.0))  # a tracker would send these
            poses = dict(zip(seen.names, seen.position.tolist(), strict=True))
            inbox.sendto(json.dumps(poses).encode(), inbox.getsockname())
            sample = SensorSample.of(json.loads(inbox.recv(4096)))
            if tick == 0:
                pipeline.start(sample)  # of a real robot also its joints: present=...
            goal = pipeline.step(sample, DT)
            bus.update(zip(goal.joint_names, goal.joint_positions.tolist(), strict=True))  # here yours: rad by joint
            hands = [goal.landmark_names.index(f"{side}_hand") for side in "lr"]
            off.append(float(np.linalg.norm(goal.landmarks_asked - goal.landmarks_reached, axis=1)[hands].max()))
            clock.sleep_until(clock.now() + DT)
    mean, most = 1e3 * np.nanmean(off), 1e3 * np.nanmax(off)  # it keeps its balance: it crouches less, and later
    print(f"{len(bus)} joints, arms of {ARM_MM} mm; a hand was {mean:.0f} mm off on average, {most:.0f} at most")


if __name__ == "__main__":
    main()
