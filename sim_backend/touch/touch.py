"""The force of soft contact for everybody's simulator: many places, depths and pressures at once.

It imports neither rig nor window nor finite elements: a `TouchTable` is evaluated.
"""

from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from sim_backend.arrays import Array
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.waves import PA_PER_MMHG
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import BARE, LUMP, VESSEL, Kind, aside
from sim_backend.touch.table import Ratios, block_of

ALONG = 48
"""Degree along the row of the polynomials that the bare block's force is drawn on: at this one
they are within 1e-6 of the table's."""


AT_ONCE = 4096
"""States whose intermediate numbers stay in a processor's cache."""


class Touch:
    """What a finger feels on a ``scene`` that a touch table knows.

    Examples
    --------
    >>> import palpate
    >>> felt = palpate.touch("TIT")
    >>> 0.8 < float(felt.force_n(32.0, 2.5)) < 1.0
    True
    """

    def __init__(self, scene: Scene) -> None:
        if scene.tissue is None or (table := table_for(scene)) is None:
            raise SceneError(
                f"{scene.name}: no touch table knows this finger on this support; `palpate touch` "
                "lists those there are, and makes others"
            )
        if not table.knows(scene):
            raise SceneError(f"{scene.name}: its touch table knows no block of this size")
        self.scene = scene
        self._half_mm = scene.indenter.width_mm_projected / 2
        self._half_width = scene.tissue.width_mm / 2 / self._half_mm
        self._unit_n = 1e-3 * scene.tissue.modulus_kpa * self._half_mm * scene.indenter.length_mm
        bare = table.ratios[BARE.name]
        self._off_by = float(np.hypot(*bare.error[:, 0]))
        self._depths = table.depths
        block = block_of(scene)
        self._bare = _drawn(bare, block, self._half_width, self._depths)
        self._bodies: list[tuple[Ratios, Array, Array]] = []
        for n, body in enumerate(scene.inclusion):
            kind, theta = parameters(scene, body)
            if not kind.fits(theta[None])[0]:
                raise SceneError(f"{scene.name}: inclusion {n + 1} lies beyond its touch table")
            ratios = table.ratios[kind.name]
            self._bodies.append((ratios, theta, _of_body(ratios, theta)))

    def force_n(self, x_mm: Any, depth_mm: Any, pressure_mmhg: Any = None) -> Array:
        """Force [N] at places ``x_mm`` pressed ``depth_mm`` deep, with ``pressure_mmhg`` in all
        lumens (by default the diastolic one), which are broadcast against each other.

        Raises ValueError where any of them is beyond what the table knows.
        """
        return self._forces(x_mm, depth_mm, pressure_mmhg)[0]

    def error_n(self, x_mm: Any, depth_mm: Any, pressure_mmhg: Any = None) -> Array:
        """What `force_n` is off by [N], one standard deviation, as held-out presses were."""
        return self._forces(x_mm, depth_mm, pressure_mmhg)[1]

    def _forces(self, x_mm: Any, depth_mm: Any, pressure_mmhg: Any) -> tuple[Array, Array]:
        low, high = self.scene.pulse.diastolic_mmhg, self.scene.pulse.systolic_mmhg
        given = low if pressure_mmhg is None else pressure_mmhg
        x, sunk, pressure = np.broadcast_arrays(*(np.asarray(v, float) for v in (
            x_mm, depth_mm, given,
        )))  # fmt: skip
        shape = x.shape
        x = x.ravel() / self._half_mm - self._half_width
        sunk = sunk.ravel() / self._half_mm
        beat = (pressure.ravel() - low) / (high - low)
        self._check(x, sunk, beat)
        blocks = [slice(k, k + AT_ONCE) for k in range(0, len(x), AT_ONCE)]
        found = [self._at(x[block], sunk[block], beat[block]) for block in blocks]
        force, error = (np.concatenate(part) for part in zip(*found, strict=True))
        return force.reshape(shape), error.reshape(shape)

    def _at(self, x: Array, sunk: Array, beat: Array) -> tuple[Array, Array]:
        """Forces (n,) and their errors [N] at places and depths (n,) in a table's units; ``beat``
        (n,) is the pressure, from 0 at diastole to 1 at systole."""
        low, high = self._depths
        from_low = np.maximum(sunk, low)  # between none and there the force is in proportion
        depth = 2 * (from_low - low) / (high - low) - 1
        part = 2 * np.abs(x) / self._half_width - 1
        bare = sunk * np.exp(_values(self._bare[..., None], part, depth)[:, 0])
        whole, variance = np.ones(len(x)), np.full(len(x), self._off_by**2)
        for ratios, theta, coefficients in self._bodies:
            across = ratios.scaled_across(aside(x, theta[None])[0])
            size = ratios.kind.size(x, theta[None])
            down = ratios.scaled_last(ratios.kind.of_depth(from_low))
            bump, pulse = (size * _values(coefficients, across, down)).T
            whole += bump + beat * pulse
            off = ratios.off_by(x, theta[None])
            variance += off[:, 0] ** 2 + (beat * off[:, 1]) ** 2
        force = self._unit_n * bare
        return force * whole, force * np.sqrt(variance)

    def _check(self, x: Array, sunk: Array, beat: Array) -> None:
        ends_mm = self._half_mm * self._half_width * np.array([0.0, 2.0])
        pulse, deepest = self.scene.pulse, self._depths[1]
        for name, values, low, high, words in (
            ("x_mm", x, -self._half_width, self._half_width, "{:g} to {:g} mm".format(*ends_mm)),
            ("depth_mm", sunk, 0, deepest, f"0 to {deepest * self._half_mm:g} mm"),
            ("pressure_mmhg", beat, 0, 1,
             f"{pulse.diastolic_mmhg:g} to {pulse.systolic_mmhg:g} mmHg"),
        ):  # fmt: skip
            if not ((values >= low - 1e-9) & (values <= high + 1e-9)).all():
                raise ValueError(f"{name}: the touch table knows {words}")


def touch(scene: Scene | str) -> Touch:
    """The force on a finger over a scene, in microseconds a state.

    Parameters
    ----------
    scene
        A scene, or a built-in one's name or a scene file's path.

    Returns
    -------
    Touch
        Callable for any places, depths and pressures of the scene.

    Raises
    ------
    SceneError
        No touch table knows the scene.

    Examples
    --------
    >>> import palpate
    >>> felt = palpate.touch("TIHA")
    >>> felt.force_n([24.0, 32.0], 2.5, [[80.0], [120.0]]).shape
    (2, 2)
    """
    return Touch(load_scene(scene) if isinstance(scene, str) else scene)


def parameters(scene: Scene, body: Any) -> tuple[Kind, Array]:
    """A body's kind and parameters (p,) in a table's units."""
    assert scene.tissue is not None
    half_mm, modulus_kpa = scene.indenter.width_mm_projected / 2, scene.tissue.modulus_kpa
    place = (body.x_mm - scene.tissue.width_mm / 2) / half_mm, body.depth_mm / half_mm
    ratio = np.log(body.modulus_kpa / modulus_kpa)
    if not isinstance(body, Artery):
        own = [*place, np.log(body.diameter_mm / half_mm), ratio]
        return LUMP, np.concatenate([own, block_of(scene)])
    pulse, per = scene.pulse, 1e-3 * PA_PER_MMHG / modulus_kpa
    plaque = body.stenosis.modulus_kpa / body.modulus_kpa if body.stenosis else 2.0
    own = [
        *place, np.log(body.inner_diameter_mm / half_mm),
        np.log(body.wall_mm / body.inner_diameter_mm), ratio, np.log(pulse.diastolic_mmhg * per),
        pulse.systolic_mmhg / pulse.diastolic_mmhg - 1,
        body.stenosis.fraction if body.stenosis else 0.0, np.log(plaque),
    ]  # fmt: skip
    return VESSEL, np.concatenate([own, block_of(scene)])


def _of_body(ratios: Ratios, theta: Array) -> Array:
    """Coefficients (degree + 1, degree + 1, 2) of place and depth over one body."""
    coordinates = ratios.scaled(ratios.kind.at(theta[:1], np.ones(1), theta[None]))
    exponents = ratios.basis.exponents
    of_body = ratios.basis.products(coordinates[:, 1:-1], exponents[:, 1:-1])[0]
    found = np.zeros((ratios.basis.degree + 1, ratios.basis.degree + 1, 2))
    np.add.at(found, (exponents[:, 0], exponents[:, -1]), of_body[:, None] * ratios.coefficients)
    return found


def _drawn(bare: Ratios, block: Array, half_width: float, ends: tuple[float, float]) -> Array:
    """Coefficients (along, depths) of the logarithm of a bare block's force over its depth, of
    places between middle and side and of the depths that it was trained on."""
    depths = bare.basis.degree
    place, depth = chebyshev.chebpts1(ALONG + 1), chebyshev.chebpts1(depths + 1)
    low, high = ends
    deep = low + (depth + 1) / 2 * (high - low)
    x, sunk = np.meshgrid((place + 1) / 2 * half_width, deep, indexing="ij")
    values = bare(x.ravel(), sunk.ravel(), np.tile(block, (x.size, 1)))[:, 0].reshape(x.shape)
    along = chebyshev.chebfit(place, values, ALONG)
    return np.asarray(chebyshev.chebfit(depth, along.T, depths).T, dtype=float)


def _values(coefficients: Array, first: Array, last: Array) -> Array:
    """Of (a, b, 2 or 1) ``coefficients`` at coordinates (n,) between -1 and 1."""
    a, b, _ = coefficients.shape
    along = chebyshev.chebvander(first, a - 1)
    down = chebyshev.chebvander(last, b - 1)
    return np.stack([((along @ part) * down).sum(axis=1) for part in coefficients.T.swapaxes(1, 2)],
                    axis=1)  # fmt: skip
