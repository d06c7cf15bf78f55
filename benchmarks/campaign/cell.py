"""A load cell that prints ``milliseconds newtons N`` 200 times a second, and what can ail it."""

import math
from dataclasses import dataclass, field

import numpy as np

from campaign.world import World

RATE_HZ = 200.0
NOISE_N = 1e-3
ZEROS_N = (-0.31, 0.31)  # what it reads in the air: a tare takes it either way
FULL_SCALE_N = 20.0
UP_S = 100.0  # it has been on for this long


@dataclass
class Sores:
    """What is wrong with the cell at the moment; each field is one fault."""

    stuck: bool = False
    clip_n: float = math.inf
    hums: bool = False  # its noise comes after the clip
    drift_n_s: float = 0.0
    silent: bool = False
    burst_s: float = 0.0
    gain: float = 1.0
    extra_n: float = 0.0
    noise: float = 1.0
    word: str = ""  # printed in place of the number
    jump_s: float = 0.0  # of its clock
    keep: float = 1.0  # the share of lines that arrive


@dataclass
class Cell:
    """The cell; ``lines`` is what was sent, with when it was measured and the true force.

    ``zero_n`` is what it reads in the air.
    """

    world: World
    seed: int
    zero_n: float
    sores: Sores = field(default_factory=Sores)
    lines: list[tuple[float, float, float]] = field(default_factory=list)  # felt at, said, true
    dead: bool = False
    since_s: float = math.inf  # when the sores began
    zero_s: float = 0.0  # when its own clock was zero
    _next_s: float = 0.0
    _last_n: float = 0.0
    _waiting: bytes = b""
    _burst_at_s: float = 0.0
    _rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._next_s = self.world.time_s
        self.zero_s = self.world.time_s - UP_S

    def due(self) -> bytes:
        """The lines that are due; call it at least once a period."""
        now, sores, out = self.world.time_s, self.sores, b""
        while self._next_s <= now:
            out += self._line(self._next_s)
            self._next_s += 1 / RATE_HZ
        if sores.silent:
            return b""
        if sores.burst_s:
            self._waiting += out
            if now < self._burst_at_s:
                return b""
            self._burst_at_s = now + sores.burst_s
            out, self._waiting = self._waiting, b""
        return out

    def _line(self, at_s: float) -> bytes:
        sores, true = self.sores, self.world.force_n
        if self._rng.uniform() > sores.keep:
            return b""
        if not sores.stuck:
            read_n = sores.gain * true + sores.extra_n
            read_n += max(at_s - self.since_s, 0.0) * sores.drift_n_s
            noise = sores.noise * NOISE_N * self._rng.standard_normal()
            clipped = min(read_n + (0.0 if sores.hums else noise) + self.zero_n, sores.clip_n)
            self._last_n = round(float(clipped + (noise if sores.hums else 0.0)), 5)
        self.lines.append((at_s, self._last_n, true))
        stamp = 1e3 * (at_s - self.zero_s + sores.jump_s)
        return f"{stamp:.0f} {sores.word or f'{self._last_n:.5f}'} N\r\n".encode()
