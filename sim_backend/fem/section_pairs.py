"""All pairs of a section that may touch: finger, support, and the walls of lumens."""

from collections.abc import Sequence

from sim_backend.arrays import Array
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.finger_gaps import Finger, finger_pairs
from sim_backend.fem.contact.lumen_self_contact import nearest_walls, wall_gaps
from sim_backend.fem.contact.pairs import ContactPairs, rigid_pairs
from sim_backend.fem.model import Section


def contact_pairs(
    section: Section, finger: Finger, u: Array, bonds: Sequence[BondedContact] = ()
) -> list[ContactPairs]:
    """Finger, support, then the walls of lumens that may close, as in the assembly's groups.

    ``bonds`` are what the finger and what the support hold.
    """
    mesh = section.mesh
    at_surface = mesh.nodes[mesh.surface] + u[mesh.surface]
    height = mesh.nodes[mesh.resting, 1] + u[mesh.resting, 1]
    finger_held, support_held = (bond.bonded for bond in bonds) if bonds else (None, None)
    found = [
        finger_pairs(
            finger, at_surface, section.surface_dofs, section.surface_share_m, finger_held
        ),
        rigid_pairs(height, section.upwards, section.resting_dofs, bonded=support_held),
    ]
    for walls in section.walls if section.self_contact else ():
        gap, gradient = wall_gaps(walls, mesh.nodes[walls.nodes] + u[walls.nodes])
        found.append(rigid_pairs(gap, gradient, walls.dofs))
    return found


def walls_cross(section: Section, u: Array) -> bool:
    """Whether any lumen's walls have passed through each other."""
    nodes = section.mesh.nodes
    return any(nearest_walls(w, nodes[w.nodes] + u[w.nodes]).gap.min() < 0 for w in section.walls)
