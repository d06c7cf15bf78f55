"""All pairs of a section that may touch: finger, support, and the walls of lumens."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.finger_gaps import Finger, finger_pairs
from sim_backend.fem.contact.lumen_self_contact import wall_gaps
from sim_backend.fem.contact.pairs import ContactPairs, node_dofs, rigid_pairs
from sim_backend.fem.model import Section


def contact_pairs(
    section: Section, finger: Finger, u: Array, bonds: Sequence[BondedContact] = ()
) -> list[ContactPairs]:
    """Finger, support, then the walls of lumens that may close, as in the assembly's groups.

    ``bonds`` are what the finger and what the support hold.
    """
    place = section.mesh.nodes + u
    resting = section.mesh.resting
    up = np.tile([0.0, 1.0], (len(resting), 1))
    found = [
        finger_pairs(finger, place, section.mesh.surface, section.surface_share_m),
        rigid_pairs(place[resting, 1], up, node_dofs(resting), np.zeros(len(resting))),
    ]
    for number, bond in enumerate(bonds):
        found[number] = replace(found[number], bonded=bond.bonded)
    for walls in section.walls if section.self_contact else ():
        gap, gradient = wall_gaps(walls, place[walls.nodes])
        found.append(rigid_pairs(gap, gradient, walls.dofs, np.zeros(len(gap))))
    return found


def walls_cross(section: Section, u: Array) -> bool:
    """Whether any lumen's walls have passed through each other."""
    place = section.mesh.nodes + u
    return any(wall_gaps(w, place[w.nodes])[0].min() < 0 for w in section.walls)
