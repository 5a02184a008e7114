"""A port in memory for dynamixel-sdk's packet handlers."""


class SdkPort:
    """As much of a port as dynamixel-sdk needs to send a frame, or to take one in."""

    is_using = False

    def __init__(self, received: bytes = b"") -> None:
        self.received, self.sent = received, b""

    def clearPort(self) -> None:
        pass

    def writePort(self, data: list[int]) -> int:
        self.sent = bytes(data)
        return len(data)

    def readPort(self, size: int) -> list[int]:
        taken, self.received = self.received[:size], self.received[size:]
        return list(taken)

    def isPacketTimeout(self) -> bool:
        return not self.received
