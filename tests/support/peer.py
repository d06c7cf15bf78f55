"""A device at the other end of a served line that has no faults and says nothing unasked."""


class Peer:
    """What `sim_backend.emulators.serving.served` asks of a device; a test says what it answers."""

    faults = ()

    def received(self, _data: bytes) -> bytes:
        return b""

    def due(self) -> bytes:
        return b""

    def fail(self, _fault: str) -> None: ...
