"""What every deck of a press is made of: the section, the rigid bodies beside it, its support."""

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.mesh import T6_EDGES
from sim_backend.fem.model import build_section
from sim_backend.fem.section import Section
from sim_backend.scene.scene_file import Scene, SceneError

CONTACT_PER_MM = 500.0
"""Penalty over the tissue's modulus [1/mm]: the force is 0.03 % low."""
MM = 1e3
MPA = 1e-6


def exported_section(scene: Scene, x_mm: float, depth_mm: float, size_mm: float | None) -> Section:
    """Six-node triangles, ``size_mm`` wide at the finger. Raises `SceneError` for what only our
    own solver knows."""
    if scene.indenter.bonded:
        raise SceneError(f"{scene.name}: indenter.bonded cannot be written for another solver")
    if scene.tissue is None and scene.bonded_support:
        raise SceneError(
            f'{scene.name}: support.contact = "bonded" cannot be written for another solver; take '
            '"frictionless"'
        )
    if scene.support.lifts:
        raise SceneError(f"{scene.name}: support.lifts cannot be written for another solver")
    finger = finger_over(scene.indenter, 0.0, 0.0)
    size_m = 1e-3 * size_mm if size_mm else 0.06 * finger.profile.scale
    return build_section(scene, 1e-3 * x_mm, depth_m=1e-3 * depth_mm, size_m=size_m, element="T6")


def contact_mpa_per_mm(section: Section) -> float:
    """Pressure of the finger's face over how far it is entered: a skin's, or a stiff penalty."""
    skin_m_per_pa = section.finger.skin_m_per_pa
    firm = CONTACT_PER_MM * MPA * section.tissue_pa
    return MPA / (MM * skin_m_per_pa) if skin_m_per_pa else firm


def material_groups(section: Section) -> list[tuple[float, float, Ints]]:
    """Shear and bulk modulus [Pa] of each material, and its cells (k,)."""
    pairs, which = np.unique(
        np.stack([section.shear, section.bulk], axis=1), axis=0, return_inverse=True
    )
    return [
        (float(shear), float(bulk), np.flatnonzero(which.ravel() == k))
        for k, (shear, bulk) in enumerate(pairs)
    ]


def held_average(section: Section) -> tuple[Ints, Array]:
    """Nodes (k,), heaviest first, whose ``weight`` (k,) times displacement along x sums to zero.

    The heaviest is the one that a solver eliminates. Empty where the support holds them anyway.
    """
    hold = section.sliding
    if not hold.weight.size or np.isin(hold.dofs[0], section.fixed).all():
        return np.empty(0, dtype=np.int64), np.empty(0)
    order = np.argsort(-hold.weight)
    return hold.dofs[0][order] // 2, hold.weight[order]


def sides_on(section: Section, chosen: Ints) -> list[tuple[int, int]]:
    """Cells and numbers in `T6_EDGES` of the sides all of whose three nodes are ``chosen``."""
    cells = section.mesh.cells
    return [
        (int(cell), number)
        for number, side in enumerate(T6_EDGES)
        for cell in np.flatnonzero(np.isin(cells[:, side], chosen).all(axis=1))
    ]


def rigid_bodies(section: Section) -> "list[Strip]":
    """The finger and, under a lone vessel, its support."""
    finger, outline = section.finger, section.finger.profile
    thick = np.array([0.0, outline.half_width / 2])
    bodies = [Strip("FINGER", outline.outline() + np.array([finger.x, finger.y]), thick)]
    if len(section.mesh.resting):
        across = section.mesh.nodes[:, 0]
        wide = np.linspace(across.min(), across.max(), 101)
        ground = np.column_stack([wide[::-1], np.zeros_like(wide)])
        bodies.append(Strip("SUPPORT", ground, np.array([0.0, -2e-3])))
    return bodies


class Strip:
    """A rigid strip of eight-node quadrilaterals whose side 1 is ``profile`` (2n + 1, 2) [m],
    the rigid body to its left; ``thick`` (2,) [m] leads into it."""

    def __init__(self, name: str, profile: Array, thick: Array) -> None:
        self.name, self._profile, self._thick = name, profile, thick

    def mesh(self) -> tuple[Array, Ints]:
        """Nodes [m] and cells (n, 8) of the strip."""
        count = len(self._profile)
        back = self._profile + self._thick
        nodes = np.vstack([self._profile, back, (self._profile + back) / 2])
        a = np.arange(0, count - 1, 2)
        cells = [a, a + 2, count + a + 2, count + a]
        cells += [a + 1, 2 * count + a + 2, count + a + 1, 2 * count + a]
        return nodes, np.stack(cells, axis=1).astype(np.int64)
