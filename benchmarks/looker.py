"""`python -m benchmarks.looker ADDRESS`: connects to a page as a browser does, and reads it to its end.

Says when it is there, and in the end how many bytes that were. Without a browser, whose drawing would cost what this
machine has.
"""

import json
import sys

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin


def look(address: str) -> int:
    """Bytes read from a page until it closes."""
    host, read = "/".join(address.split("/")[:3]), 0
    where = address.rstrip("/").replace("http", "ws", 1) + "/ws"
    with connect(where, origin=Origin(host), max_size=None) as link:
        link.send(json.dumps({"type": "hello", "input": "watch", "id": "looker"}))
        print("looks", flush=True)
        while True:
            try:
                read += len(link.recv())
            except ConnectionClosed:
                return read


if __name__ == "__main__":
    print(look(sys.argv[1]))
