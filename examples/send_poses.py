"""Send a performer who stands and moves arms as JSON over UDP (docs/live.md): send_poses.py [HOST [PORT [S]]]."""

import json
import math
import socket
import sys
import time

UPRIGHT, RATE_HZ = [1, 0, 0, 0], 60
STILL = {"head": (0.0, 0.0, 1.6), "l_wrist": (0.0, 0.25, 0.8), "r_wrist": (0.0, -0.25, 0.8)}
STILL |= {"l_ankle": (0.0, 0.1, 0.08), "r_ankle": (0.0, -0.1, 0.08)}


def message(number: int) -> bytes:
    """One frame: x forward, y left, z up, metres. 6 s still, 3 s the left arm to the front, 3 s the right one aside."""
    seconds = number / RATE_HZ
    done = [min(max((seconds % 12.0 - begin) / 3.0, 0.0), 1.0) for begin in (6.0, 9.0)]
    front, raised = (math.sin(math.pi * share) for share in done)  # 0 hanging, 1 up
    turn = 0.5 * math.pi * front  # of the left arm, 0.55 m long: a run asks for it first
    sway = 0.001 * math.sin(2.0 * math.pi * seconds / 4.0)  # a person sways; lost trackers stand still
    places = STILL | {"l_wrist": (0.55 * math.sin(turn), 0.25, 1.35 - 0.55 * math.cos(turn))}
    places |= {"r_wrist": (0.1 * raised, -0.25 - 0.35 * math.sin(math.pi * raised), 0.8 + 0.75 * raised)}
    poses = {name: {"p": (x + sway, y, z), "q": UPRIGHT} for name, (x, y, z) in places.items()}
    return json.dumps(
        {"axes": "rep103", "quaternion": "wxyz", "time": seconds, "frame": number, "poses": poses}
    ).encode()


def main(host: str = "127.0.0.1", port: str = "14150", seconds: str = "60") -> None:
    """Send in real time."""
    begin = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(int(float(seconds) * RATE_HZ)):
            sender.sendto(message(number), (host, int(port)))
            time.sleep(max(0.0, begin + (number + 1) / RATE_HZ - time.monotonic()))


if __name__ == "__main__":
    main(*sys.argv[1:])
