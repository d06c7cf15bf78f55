"""Question and answer on a line: one exchange at a time, each with a deadline."""

import time

from drivers.core.errors import DeviceFault
from drivers.core.ports import Port, nobody_else, open_port, read_some

MAX_ANSWER_BYTES = 4096  # bytes of an answer; what goes on beyond is none


class NoAnswer(DeviceFault):
    """The answer did not come whole in time, or not as it should be: the next one may."""


class Line:
    """An open line to ``device``; used by one thread.

    Raises `DeviceAbsent` where it cannot be opened.
    """

    def __init__(self, device: str, port: str, baud: int, answer_s: float) -> None:
        self.device = device
        self._answer_s = answer_s
        self._in_use = nobody_else(port)  # until it has answered once
        self._line: Port = open_port(device, port, baud)

    def say(self, data: bytes) -> None:
        """Send what is not answered. Raises `OSError` if the line is lost."""
        self._line.write(data)

    def ask(self, data: bytes, *, end: bytes = b"", size: int = 0) -> bytes:
        """Send ``data``; what comes until ``end`` (which is cut off), or ``size`` bytes.

        What came before is forgotten. Raises `NoAnswer`, or `OSError` if the line is lost.
        """
        self._line.reset_input_buffer()
        self._line.write(data)
        return self.listen(end=end, size=size)

    def listen(self, *, end: bytes = b"", size: int = 0) -> bytes:
        """The same without a question, for what a device says by itself or in several lines."""
        got = b""
        due_s = time.monotonic() + self._answer_s
        while not (end and got.endswith(end)) and not (size and len(got) >= size):
            if time.monotonic() > due_s or len(got) > MAX_ANSWER_BYTES:
                heard = f", only {got!r}" if got else ""
                raise NoAnswer(
                    self.device, f"no answer within {self._answer_s:g} s{heard or self._in_use}"
                )
            got += read_some(self._line)
        self._in_use = ""
        return got.removesuffix(end) if end else got[:size]

    def close(self) -> None:
        """Release the port."""
        self._line.close()
