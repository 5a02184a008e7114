"""`python -m benchmarks.looker ADDRESS`: connects to a page as a browser does, and reads it to its end.

Says when it is there, and in the end how many bytes that were. Without a browser, whose drawing would cost what this
machine has.
"""

import sys

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 0.0, 0.5),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""Without one a client does not count as a viewer."""


def look(address: str) -> int:
    """Bytes read from a page until it closes."""
    import msgspec
    import viser

    host, read = "/".join(address.split("/")[:3]), 0
    link = connect(
        address.rstrip("/").replace("http", "ws", 1),
        origin=Origin(host),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        max_size=None,
    )
    with link:
        link.send(msgspec.msgpack.encode(CAMERA))
        print("looks", flush=True)
        while True:
            try:
                read += len(link.recv())
            except ConnectionClosed:
                return read


if __name__ == "__main__":
    print(look(sys.argv[1]))
