"""What goes wrong: the kinds, and one drawn from a seed with the instant at which it strikes.

Each kind says what it demands of the scan: whether the probe must be up at the end, and for how
long no guard that reads this rig can know (``blind_s``; infinite: only the limits of depth and the
length of a move bound what happens). The judge takes these figures from here, and the safety case
in the docs repeats them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaign.cell import ZEROS_N
from campaign.limits import RAMP_S
from campaign.world import Bed

NAN = math.nan


@dataclass(frozen=True)
class Kind:
    """``where`` it strikes; ``up``: the probe must be lifted; ``ends``: the scan must not complete.

    Otherwise it may go on and complete, if what it stores is true. Unless ``heard``, no order to
    stop can reach the stage any more: then only its last move's target bounds the force.
    """

    name: str
    where: str
    blind_s: float = 0.0
    up: bool = True
    ends: bool = True
    heard: bool = True


# On the way down no force may be older than takes it to the limit on the hardest thing that the rig
# was told of: 1.6 N at 6 N/mm and 6.25 mm/s are 43 ms. The supervisor looks every 10 ms.
SILENCE_S = 0.06
# One that clips and hums is believed until the tip went on by half of its way in contact.
HALF_S = 0.5 * RAMP_S
STUCK_S = 0.13  # a live cell that repeats itself 20 times (0.1 s) is stuck; seen likewise

KINDS = (
    Kind("cell stuck", "cell", STUCK_S),
    Kind("cell clipped", "cell", STUCK_S, ends=False),
    Kind("cell clipped with noise", "cell", HALF_S, ends=False),
    Kind("cell drifting", "cell", math.inf, ends=False),
    Kind("cell silent", "cell", SILENCE_S),
    Kind("cell gone", "cell", 0.05),
    Kind("cell in bursts", "cell", SILENCE_S, ends=False),
    Kind("cell says nan", "cell", SILENCE_S),
    Kind("cell prints nonsense", "cell", SILENCE_S),
    Kind("cell reversed", "cell", STUCK_S, ends=False),
    Kind("cell clock back", "cell", SILENCE_S, ends=False),
    Kind("cell clock ahead", "cell", SILENCE_S, ends=False),
    Kind("cell spikes", "cell"),
    Kind("cell loses lines", "cell", 0.1, ends=False),
    Kind("board deaf", "board", up=False, heard=False),
    Kind("board mute", "board", up=False),
    Kind("board gone", "board", up=False, heard=False),
    Kind("board slow", "board", ends=False),
    Kind("board stalled", "board", up=False),
    Kind("board runs on", "board"),
    Kind("board loses stops", "board", 0.3, ends=False),
    Kind("board stops late", "board", 0.15, ends=False),
    Kind("board lies", "board", ends=False),
    Kind("board answers late", "board", 0.1, ends=False),
    Kind("board pauses", "board", ends=False),
    Kind("board alarm", "board", up=False),
    Kind("board restarts", "board", up=False),
    Kind("board garbles", "board", ends=False),
    Kind("hard bed", "bed", ends=False),
    Kind("higher bed", "bed", ends=False),
    Kind("cough", "bed", ends=False),
    Kind("pulled sideways", "bed", up=False, ends=False),
    Kind("pushed deeper", "bed", ends=False),
    Kind("SIGINT", "signal"),
    Kind("SIGTERM", "signal"),
    Kind("SIGHUP", "signal"),
    Kind("SIGQUIT", "signal"),
    Kind("SIGINT to the group", "signal"),
    Kind("SIGHUP to the group", "signal"),
    Kind("SIGINT storm", "signal", up=False),
    Kind("ctrl-c typed", "signal"),
    Kind("ctrl-backslash typed", "signal"),
    Kind("terminal closed", "signal"),
    Kind("SIGKILL", "signal"),
    Kind("guards killed", "signal", heard=False),  # until others have taken over
    Kind("guards stopped", "signal", heard=False),
    Kind("SIGSTOP and SIGCONT", "signal", ends=False),
    Kind("SIGSTOP and SIGCONT, group", "signal", ends=False),
    Kind("ctrl-z typed, then fg", "signal", ends=False),
    Kind("terminal not read", "signal", ends=False),
    Kind("no memory", "machine", ends=False),
    Kind("no space", "machine", ends=False),
    Kind("no descriptors", "machine", ends=False),
    Kind("interpreter busy", "machine", ends=False),
    Kind("interpreter held", "machine", ends=False),
    Kind("date set", "machine", ends=False),
    Kind("connection flood", "machine", ends=False),
    Kind("run file deleted", "file", ends=False),
    Kind("run file replaced", "file", ends=False),
    Kind("run file locked", "file", ends=False),
    Kind("run file locked for long", "file", ends=False),
    Kind("abort", "user"),
    Kind("stop", "user", up=False),
    Kind("pause and resume", "user", ends=False),
    Kind("second program", "user", ends=False),
)
ARM_KINDS = (
    Kind("arm stops to protect", "arm", up=False),
    Kind("arm stopped in an emergency", "arm", up=False),
    Kind("arm loses its program", "arm", up=False),
    Kind("arm silent", "arm", SILENCE_S, up=False),
    Kind("arm gone", "arm", SILENCE_S, up=False, heard=False),
    Kind("arm cut off", "arm", SILENCE_S),
    *(kind for kind in KINDS if kind.where not in ("cell", "board")),
)
BY_NAME = {kind.name: kind for kind in (*KINDS, *ARM_KINDS)}
REAL_LINES = ("board answers late", "board garbles")  # mean nothing without a protocol
SIMULATED = tuple(
    kind for kind in KINDS if kind.where in ("cell", "board", "bed") and kind.name not in REAL_LINES
)


@dataclass(frozen=True)
class Fault:
    """One fault: its kind, three numbers in 0 to 1 that say how bad it is, and when it strikes.

    With ``pressed_m`` it strikes ``delay_s`` after the tip is first that deep at station
    ``station`` (counted from 0), otherwise ``delay_s`` after the first move.
    """

    kind: Kind
    size: tuple[float, float, float]
    delay_s: float
    station: int = 0
    pressed_m: float = NAN


@dataclass(frozen=True)
class Draw:
    """One run of the campaign: everything that is random in it comes from ``seed``."""

    seed: int
    faults: tuple[Fault, ...]
    bed: Bed
    serial: bool
    arm: bool = False

    @property
    def name(self) -> str:
        """The kinds, in the order in which they strike."""
        return " + ".join(fault.kind.name for fault in self.faults)

    @property
    def zero_n(self) -> float:
        """What the cell reads in the air."""
        return ZEROS_N[int(np.random.default_rng([self.seed, 7]).integers(2))]


def draw(seed: int, count: int, kinds: Sequence[Kind] = KINDS, *, arm: bool = False) -> Draw:
    """One run with ``count`` faults; the seed's own number says which kind is the first."""
    rng = np.random.default_rng([seed, count])
    first = kinds[seed % len(kinds)]
    chosen = [first]
    while len(chosen) < count:
        other = kinds[int(rng.integers(len(kinds)))]
        if other not in chosen:
            chosen.append(other)
    return of_kinds(seed, chosen, rng, arm=arm)


def of_kinds(
    seed: int, kinds: Sequence[Kind], rng: np.random.Generator, *, arm: bool = False
) -> Draw:
    """One run with these kinds, everything else drawn."""
    first = _fault(kinds[0], rng)
    faults = [first]
    for kind in kinds[1:]:
        delay_s = first.delay_s + float(rng.uniform(0.0, 0.4))
        own = _fault(kind, rng)
        faults.append(Fault(kind, own.size, delay_s, first.station, first.pressed_m))
    return Draw(seed, tuple(faults), _bed(faults, rng), bool(rng.integers(2)), arm)


def _fault(kind: Kind, rng: np.random.Generator) -> Fault:
    a, b, c = (float(v) for v in rng.uniform(size=3))
    if rng.uniform() < 0.3:  # at any instant of the scan, which takes about 4 s
        return Fault(kind, (a, b, c), float(rng.uniform(0.0, 4.0)))
    station = int(rng.integers(2))
    pressed_m = float(rng.uniform(0.05e-3, 2.4e-3))
    return Fault(kind, (a, b, c), float(rng.uniform(0.0, 0.4)), station, pressed_m)


def _bed(faults: Sequence[Fault], rng: np.random.Generator) -> Bed:
    """Soft, and for every other run hard or higher from the second station on."""
    kinds = [fault.kind.name for fault in faults]
    between_m = 13e-3
    if "higher bed" in kinds:
        return Bed(hard_from_m=between_m, hard=1.0, step_m=float(rng.uniform(1.0e-3, 1.9e-3)))
    if "hard bed" in kinds or rng.uniform() < 0.4:
        return Bed(hard_from_m=between_m, hard=float(rng.uniform(2.0, 25.0)))
    return Bed()
