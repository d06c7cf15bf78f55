"""What a station answers: force and stress over depth and lumen pressure, as curves; and which
station it is of."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array, Bools
from sim_backend.models.curve import HermiteCurve
from sim_backend.models.kept_tables import table_file
from sim_backend.models.taxel_shares import TaxelShares
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.symmetry import symmetric_parts
from sim_backend.scene.taxels import TaxelArray
from sim_backend.scene.waves import PA_PER_MMHG

PRESSURE_SLACK = 0.02
"""Share of the wave's span that a pressure may lie outside it: a wave is sampled."""
SLACK = 1e-8
"""What a depth [m] may lie outside a range, and a pressure over the range's end: the rounding of a
path."""
WAY = 6
"""Number of the way of solving; what was kept on disk by another way is solved again."""


class OutOfRange(ValueError):
    """A depth or pressure that a station does not know; says which it does."""


class Range(NamedTuple):
    """(low, high) of the depths [m] and lumen pressures [Pa] that a station knows."""

    depth_m: tuple[float, float]
    pressure_pa: tuple[float, float]

    def check(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> None:
        """Raises `OutOfRange` unless all are known; what is not a number is not."""
        slack_pa = SLACK * abs(self.pressure_pa[1])
        for what, asked, (low, high), slack, scale, unit in (
            ("depth", depth_m, self.depth_m, SLACK, 1e3, "mm"),
            ("lumen pressure", pressure_pa, self.pressure_pa, slack_pa, 1e-3, "kPa"),
        ):
            values = np.asarray(asked, dtype=float)
            known: Bools = (values >= low - slack) & (values <= high + slack)
            if not known.all():
                raise OutOfRange(
                    f"a {what} of {scale * values[~known].flat[0]:.4g} {unit} is beyond the "
                    f"{scale * low:.4g} to {scale * high:.4g} {unit} that this model knows"
                )


class Station(NamedTuple):
    """What is solved: a place [m] of a scene down to a depth [m], with the ``array``'s taxels if
    there is one. Of places that are each other's
    mirror images it is the left one, and along a solid the one at larger z.

    Where nothing but a solid's ends varies along z, a place beside the middle is solved as two
    blocks that are symmetric about it, each half modelled: with ends a and b away the force is
        F(a, b) = F + e(a) + e(b) = [F(a, a) + F(b, b)] / 2
    but for what the ends do to each other's effect, of the order of (e(a) - e(b))^2 / F.
    """

    scene: Scene
    x_m: float
    max_depth_m: float
    array: TaxelArray | None = None

    @property
    def parts(self) -> list[tuple["Station", Path]]:
        """The stations whose mean is the answer, and where on disk each one's is kept."""
        return [
            (part, table_file("solid", [part.scene.model_dump(mode="json", exclude={"name"}),
                                        part.x_m, part.max_depth_m, WAY, *self._array_key]))
            for scene in symmetric_parts(self.scene) for part in [self._replace(scene=scene)]
        ]  # fmt: skip

    @property
    def _array_key(self) -> list[dict[str, object]]:
        return [] if self.array is None else [asdict(self.array)]


class Left(NamedTuple):
    """Shares that may be missed of the resting force, of the change from it, of the deepest force
    (what lies between the depths solved), and of the force by a change however ``faint``."""

    rest: float
    change: float
    between: float
    faint: float = 0.0


@dataclass(frozen=True)
class StationResponse:
    """The elastic answer of one place ``x_m`` down to ``max_depth_m``.

    ``bulge_m``: how far the resting pressure lifts the surface; contact begins there. All arguments
    broadcast: ``depth_m`` below the surface (0 and less: in the air, unless a filled vessel bulges
    there), ``pressure_pa`` in every lumen. Methods raise `OutOfRange` outside
    ``range``; none returns NaN.
    """

    x_m: float
    max_depth_m: float
    length_m: float
    bulge_m: float
    force: "Curve"
    stress: "Curve"
    left: "Left"
    taxels: TaxelShares | None = None

    @property
    def range(self) -> Range:
        """Any height above the place, the wave with a little room for sampling; without a
        vessel any pressure."""
        low, high = self.force.low_pa, self.force.high_pa
        slack = PRESSURE_SLACK * (high - low)
        pressures = (low - slack, high + slack) if high > low else (-np.inf, np.inf)
        return Range((-np.inf, self.max_depth_m), pressures)

    def force_n(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Normal force [N] on the whole finger, 0 out of contact."""
        return self.length_m * self._at(self.force, depth_m, pressure_pa)

    def von_mises_pa(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Von Mises stress [Pa] at the surface under the finger."""
        return self._at(self.stress, depth_m, pressure_pa)

    def shares(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """What each taxel takes of the force (n, rows, columns) at depths and pressures (n,)."""
        assert self.taxels is not None  # nobody asks what has not been solved
        self.range.check(depth_m, pressure_pa)
        sunk = np.asarray(depth_m, dtype=float) + self.bulge_m
        return self.taxels(sunk, np.asarray(pressure_pa) - self.force.rest_pa)

    def error_n(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """What the force may be off by [N]."""
        rest_pa, force = self.force.rest_pa, self.force_n(depth_m, pressure_pa)
        rest = self.force_n(depth_m, rest_pa)
        deepest = self.force_n(self.max_depth_m, rest_pa)
        change = self._steepest(depth_m, rest_pa, pressure_pa)
        off = self.left.rest * rest + self.left.change * change + self.left.between * deepest
        return np.asarray(np.where(force > 0, off, 0.0))

    def pulse_error_n(self, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike) -> Array:
        """What the change of force between two pressures may be off by [N]: of the change itself,
        and of how far it is from that at the full depth, where the curve over pressure is the
        solved one. What both forces' errors have in common drops out."""
        low, high = (self.force_n(depth_m, p) for p in (low_pa, high_pa))
        full = (self.force_n(self.max_depth_m, p) for p in (low_pa, high_pa))
        change = self._steepest(depth_m, low_pa, high_pa)
        faint = np.where(change > 0, self.left.faint * np.maximum(high, low), 0.0)
        return np.asarray(self.left.change * np.maximum(change, np.abs(np.subtract(*full))) + faint)

    def _steepest(self, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike) -> Array:
        """The change [N] between two pressures, or p dF/dp's if that is more: near the pressure at
        which a wall inflates without bound, a wall that is a share off in stiffness is as much off
        in pressure."""
        sunk, *ends = np.broadcast_arrays(np.asarray(depth_m) + self.bulge_m, low_pa, high_pa)
        low, high = (self.force_n(depth_m, p) for p in ends)
        by_low, by_high = (
            np.where(force > 0, p * self.length_m * self.force.by_pressure(sunk, p), 0.0)
            for force, p in zip((low, high), ends, strict=True)
        )
        return np.asarray(np.maximum(np.abs(high - low), np.abs(by_high - by_low)))

    def _at(self, curve: "Curve", depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        self.range.check(depth_m, pressure_pa)
        sunk = np.maximum(np.asarray(depth_m, dtype=float) + self.bulge_m, 0.0)
        value = curve(sunk, np.asarray(pressure_pa))
        return np.asarray(np.where(sunk > 0, np.maximum(value, 0.0), 0.0))


@dataclass(frozen=True)
class Curve:
    """A quantity over sunk depth: at rest, and what each power of the pressure over rest [Pa] adds,
    the first power first. ``low_pa`` to ``high_pa`` is the wave."""

    rest: HermiteCurve
    powers: tuple[HermiteCurve, ...]
    rest_pa: float
    low_pa: float
    high_pa: float

    def __call__(self, sunk: Array, pressure_pa: Array) -> Array:
        over = pressure_pa - self.rest_pa
        adds = (one(sunk) * over**k for k, one in enumerate(self.powers, 1))
        return np.asarray(sum(adds, self.rest(sunk) + 0.0 * over))

    def by_pressure(self, sunk: Array, pressure_pa: Array) -> Array:
        over = pressure_pa - self.rest_pa
        each = (k * one(sunk) * over ** (k - 1) for k, one in enumerate(self.powers, 1))
        return np.asarray(sum(each, 0.0 * sunk * over))


def levels_pa(scene: Scene) -> tuple[float, float, float]:
    """Resting pressure, then the ends of the wave [Pa]."""
    low, high = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    rest = low + 0.25 * (high - low)
    return rest * PA_PER_MMHG, low * PA_PER_MMHG, high * PA_PER_MMHG
