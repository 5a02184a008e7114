"""A port in memory for dynamixel-sdk's packet handlers."""


class SdkPort:
    """As much of a port as dynamixel-sdk needs to send a frame, or to take one in."""

    is_using = False

    def __init__(self, heard: bytes = b"") -> None:
        self.heard, self.sent = heard, b""

    def clearPort(self) -> None:
        pass

    def writePort(self, data: list[int]) -> int:
        self.sent = bytes(data)
        return len(data)

    def readPort(self, size: int) -> list[int]:
        taken, self.heard = self.heard[:size], self.heard[size:]
        return list(taken)

    def isPacketTimeout(self) -> bool:
        return not self.heard
