"""One register of a control table: where it lies, what its bytes mean, what may be written."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Register:
    """`size` bytes at `address`, little-endian; one count is `scale` of the SI `unit`, both None for plain counts.

    A signed register holds two's complement, unless `direction_bit` is set (protocol 1.0's speeds and loads): then that
    bit says clockwise, hence negative, and the bits below it hold the magnitude. `lowest`, `highest`: the widest range
    that may be written, counts, None without a limit of its own; what limit registers and modes narrow is not in it.
    `initial`: the maker's default in counts, None where the servo itself finds it at start.
    """

    name: str
    address: int
    size: int
    signed: bool
    writable: bool
    scale: float | None
    unit: str | None
    lowest: int | None
    highest: int | None
    initial: int | None
    direction_bit: int | None = None

    @property
    def end(self) -> int:
        """First address after this register."""
        return self.address + self.size

    @property
    def narrowest(self) -> int:
        """Lowest count that the bytes can hold."""
        if self.direction_bit is not None:
            return 1 - (1 << self.direction_bit)
        return -(1 << (8 * self.size - 1)) if self.signed else 0

    @property
    def widest(self) -> int:
        """Highest count that the bytes can hold."""
        if self.direction_bit is not None:
            return (1 << self.direction_bit) - 1
        return (1 << (8 * self.size - self.signed)) - 1

    def decode(self, data: bytes) -> int:
        """Return the counts in `data`, exactly `size` bytes. Raises ValueError for another length."""
        if len(data) != self.size:
            raise ValueError(f"{self.name} has {self.size} bytes, not {len(data)}")
        if self.direction_bit is None:
            return int.from_bytes(data, "little", signed=self.signed)
        raw = int.from_bytes(data, "little")
        magnitude = raw & self.widest
        return -magnitude if raw >> self.direction_bit & 1 else magnitude

    def encode(self, counts: int) -> bytes:
        """Return the bytes of `counts`. Raises ValueError beyond the register's width."""
        if not self.narrowest <= counts <= self.widest:
            raise ValueError(f"{self.name} holds {self.narrowest} to {self.widest}, not {counts}")
        if self.direction_bit is not None and counts < 0:
            return ((1 << self.direction_bit) - counts).to_bytes(self.size, "little")
        return counts.to_bytes(self.size, "little", signed=self.signed)

    def allows(self, counts: int) -> bool:
        """Whether `counts` lies within `lowest` and `highest`."""
        return (self.lowest is None or counts >= self.lowest) and (self.highest is None or counts <= self.highest)
