"""What really happened, as the process that holds the world wrote it."""

from dataclasses import dataclass

from drivers.core.arrays import Array

T, X, Y, Z, FORCE, SIDE, DEPTH, MOVING = range(8)


@dataclass(frozen=True)
class Truth:
    """What the process of the truth wrote; see `serve.save`."""

    rows: Array
    lines: Array
    stops: Array
    jogs: Array
    struck: Array
    late_s: float
