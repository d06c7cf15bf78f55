"""Every mutant."""

from mutants.around import AROUND
from mutants.devices import DEVICES
from mutants.elsewhere import ELSEWHERE
from mutants.guarded import GUARDED
from mutants.mutant import Mutant
from mutants.numerics import NUMERICS
from mutants.outside import OUTSIDE
from mutants.overlooked import OVERLOOKED
from mutants.stored import STORED

MUTANTS: tuple[Mutant, ...] = (
    *GUARDED, *AROUND, *STORED, *DEVICES, *ELSEWHERE, *NUMERICS, *OUTSIDE, *OVERLOOKED,
)  # fmt: skip
