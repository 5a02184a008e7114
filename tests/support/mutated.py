"""Real datagrams with random damage, for long fuzzing: from a seed, faster than hypothesis."""

from collections.abc import Sequence

import numpy as np


def mutated(generator: np.random.Generator, real: Sequence[bytes]) -> bytes:
    """One of them with up to three bytes changed, mostly early ones; one in ten is also cut, one in ten random."""
    if generator.random() < 0.1:
        return generator.bytes(int(generator.integers(0, 900)))
    datagram = bytearray(real[int(generator.integers(len(real)))])
    for _ in range(int(generator.integers(0, 4))):
        reach = len(datagram) if generator.random() < 0.5 else min(len(datagram), 32)
        datagram[generator.integers(reach)] = generator.integers(256)
    if generator.random() < 0.1:
        del datagram[generator.integers(len(datagram)) :]
    return bytes(datagram)
