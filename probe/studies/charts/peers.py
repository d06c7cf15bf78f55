"""The same press by FElupe, for the chart: its own elements, contact, pressure and Newton's method.

Plane strain and a cylinder: FElupe has no neo-Hooke in plane stress. Nodes and cells are ours, so
that solvers are compared and not meshes; everything else is FElupe's.
"""

import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.sparse.linalg import MatrixRankWarning

from sim_backend.fem.model import build_section
from sim_backend.fem.newton import CannotSolve
from sim_backend.scene.indenter import Cylinder
from sim_backend.scene.scene_file import Scene

State = tuple[float, float]

STEP_M = 0.1e-3
SMALLEST_SHARE = 1 / 64
PENALTY = 100.0
"""Over the mean stiffness of the nodes: forces agree with our exact contact to 0.01 %."""
NEWTON = {"maxiter": 12, "tol": 1e-6, "verbose": 0}


def has_felupe() -> bool:
    """Whether the ``peers`` extra is there."""
    return find_spec("felupe") is not None


def felupe_forces(
    scene: Scene, x_m: float, depth_m: float, pressures_pa: Sequence[float], size_m: float
) -> tuple[list[float], int]:
    """Force [N/m] at each lumen pressure, and the degrees of freedom.

    Four-node quadrilaterals of mean dilatation, frictionless penalty contact, steps halved where
    Newton's method fails. Raises `CannotSolve` where halving does not help, ValueError for a
    scene in plane stress or of another finger.
    """
    import felupe as fe

    if scene.plane != "strain" or not isinstance(scene.indenter, Cylinder) or not scene.tissue:
        raise ValueError("FElupe is compared in plane strain, under a cylinder on a block")
    section = build_section(scene, x_m, depth_m=depth_m, size_m=size_m, element="Q4M")
    radius, top = 1e-3 * scene.indenter.radius_mm, section.finger.y
    points = np.vstack([section.mesh.nodes, [[x_m, top + radius]]])
    centre = len(points) - 1
    mesh = fe.Mesh(points, section.cells.nodes, "quad")
    field = fe.FieldContainer([fe.FieldPlaneStrain(fe.RegionQuad(mesh), dim=2)])
    # FElupe's neo-Hooke law and its mean dilatation take moduli per cell
    law = fe.NeoHooke(mu=section.shear)
    law.chunksize = None  # from 11.3 on it takes some cells at once, and all their moduli
    body = fe.SolidBodyNearlyIncompressible(law, field, bulk=section.bulk)
    lumens = []
    for sides in section.lumens:
        on_wall = np.isin(np.arange(len(points)), sides.dofs[:, ::2] // 2)
        wall = fe.RegionQuadBoundary(mesh, only_surface=True, mask=on_wall, ensure_3d=True)
        lumens.append(fe.SolidBodyPressure(fe.FieldContainer([fe.FieldPlaneStrain(wall, dim=2)])))
    contact = fe.ContactRigidCylinder(
        field, points=section.mesh.surface, centerpoint=centre, radius=radius,
        multiplier=PENALTY, items=[body], curvature="trial", symmetric=True,
    )  # fmt: skip
    on_bottom = np.isin(np.arange(len(points)), section.mesh.bottom)
    middle = section.mesh.bottom[len(section.mesh.bottom) // 2]
    at_centre = np.arange(len(points)) == centre
    held = {
        "bottom": fe.Boundary(field[0], mask=on_bottom, skip=(1, 0)),
        "middle": fe.Boundary(field[0], mask=np.arange(len(points)) == middle, skip=(0, 1)),
        "centre": fe.Boundary(field[0], mask=at_centre, skip=(0, 1)),
        "down": fe.Boundary(field[0], mask=at_centre, skip=(1, 0)),
    }
    fixed, free = fe.dof.partition(field, held)

    items = [body, *lumens, contact]

    def continuation(x: Any, start: State, goal: State) -> tuple[Any, float]:
        """The field and the force after going from (depth, pressure) to another."""
        done, step, force = 0.0, 1.0, np.nan
        while done < 1:
            to = min(done + step, 1.0)
            depth, pressure = (a + to * (b - a) for a, b in zip(start, goal, strict=True))
            held["down"].update(-depth)
            for lumen in lumens:
                lumen.results.pressure = pressure
            given = fe.dof.apply(field, held, fixed)
            try:
                # steps too large make nan and singular matrices, and are halved
                with np.errstate(all="ignore"), warnings.catch_warnings():
                    warnings.simplefilter("ignore", MatrixRankWarning)
                    found = fe.newtonraphson(
                        items=items, x0=x, dof0=fixed, dof1=free, ext0=given, **NEWTON
                    )
            except (fe.tools.NewtonConvergenceError, RuntimeError) as error:  # or SuperLU's own
                step /= 2
                if step < SMALLEST_SHARE:
                    raise CannotSolve("FElupe", f"FElupe stopped: {error}") from None
            else:
                x, done, force = found.x, to, abs(float(found.fun[2 * centre + 1]))
                step = min(2 * step, 1.0)
        return x, force

    steps = max(1, round(depth_m / STEP_M))
    path = [(depth_m * k / steps, pressures_pa[0] * k / steps) for k in range(1, steps + 1)]
    path += [(depth_m, p) for p in pressures_pa[1:]]
    x, before = field, (0.0, 0.0)
    forces: list[float] = []
    for goal in path:
        x, force = continuation(x, before, goal)
        forces.append(force)
        before = goal
    return forces[-len(pressures_pa) :], len(free)
