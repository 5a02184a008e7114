"""Send a waving performer as JSON over UDP (docs/json-input.md): python send_poses.py [HOST [PORT [SECONDS]]]."""

import json
import math
import socket
import sys
import time

UPRIGHT, RATE_HZ = [1, 0, 0, 0], 60
STILL = {
    "head": (0.0, 0.0, 1.6),
    "l_wrist": (0.0, 0.25, 0.8),
    "l_ankle": (0.0, 0.1, 0.08),
    "r_ankle": (0.0, -0.1, 0.08),
}


def message(number: int) -> bytes:
    """The pose of one frame: x forward, y left, z up, metres; the right hand waves beside the head."""
    seconds = number / RATE_HZ
    places = STILL | {"r_wrist": (0.2, -0.4 + 0.15 * math.sin(2.0 * math.pi * 0.5 * seconds), 1.6)}
    poses = {name: {"p": place, "q": UPRIGHT} for name, place in places.items()}
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
