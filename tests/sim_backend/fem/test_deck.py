"""A press in files for others: decks that CalculiX answers as we do, and VTU files."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from small_solid import small_solid

from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.io.deck import ccx_forces_n_per_mm, write_deck
from sim_backend.fem.io.vtu import write_vtu
from sim_backend.models.press import Press, press
from sim_backend.scene.scene_file import Scene, Support, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

needs_ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not here")


def run(deck):
    ran = subprocess.run(
        ["ccx", "-i", deck.stem], cwd=deck.parent, env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-2000:]
    return ccx_forces_n_per_mm(deck)


@needs_ccx
@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_calculix_agrees(plane, tmp_path):
    loose = Support(contact="frictionless")
    scene = load_scene("HAOT").model_copy(update={"plane": plane, "support": loose})
    deck = write_deck(scene, 32.0, 0.4, [80.0], tmp_path / "haot.inp", size_mm=0.8)
    # elastic: larger steps on the way change nothing at its end, and take half of the time
    deck.write_text(deck.read_text().replace("0.02, 1., 1.E-6, 0.05", "0.02, 1., 1.E-6, 0.2"))
    (theirs,) = run(deck)
    _, (ours,) = solve_finite(scene, 0.032, 0.4e-3, [80 * PA_PER_MMHG], 0.8e-3)
    assert 1e-3 * ours.force_n_per_m == pytest.approx(theirs, rel=0.01)


def test_a_deck_holds_the_scene(tmp_path):
    deck = write_deck(load_scene("TISA"), 30.0, 2.0, (0.0, 80.0), tmp_path / "tisa.inp")
    text = deck.read_text()
    assert text.count("*STEP") == text.count("*END STEP") == 2
    assert text.count("*HYPERELASTIC, NEO HOOKE") == 3  # tissue, wall, stenosis
    assert "TYPE=CPS6" in text
    shear_mpa = 0.050 / (2 * 1.49)
    assert any(line.startswith(f"{shear_mpa / 2:.6e}"[:6]) for line in text.splitlines()), (
        "C10 = G/2 of the tissue"
    )
    loads = [float(v.split(",")[2]) for v in text.splitlines() if ", P1, " in v]
    assert max(loads) == pytest.approx(80 * PA_PER_MMHG * 1e-6)
    assert min(loads) == 0.0


def test_every_tissue_element_has_one_material(tmp_path):
    deck = write_deck(load_scene("TIT"), 32.0, 2.0, (), tmp_path / "tit.inp")
    lines = deck.read_text().splitlines()
    start = next(i for i, s in enumerate(lines) if s.startswith("*ELEMENT, TYPE=CPS6"))
    stop = next(i for i in range(start + 1, len(lines)) if lines[i].startswith("*"))
    elements = {int(s.split(",")[0]) for s in lines[start + 1 : stop]}
    given = []
    for i, line in enumerate(lines):
        if line.startswith("*ELSET, ELSET=E"):
            stop = next(j for j in range(i + 1, len(lines)) if lines[j].startswith("*"))
            given += [int(s) for s in lines[i + 1 : stop]]
    assert sorted(given) == sorted(elements)
    assert len(np.unique(given)) == len(given)


@pytest.mark.parametrize("finger", [
    {"shape": "cylinder", "radius_mm": 4.0},
    {"shape": "flat", "width_mm": 8.0, "edge_radius_mm": 0.5},
    {"shape": "wedge", "angle_deg": 90.0, "tip_radius_mm": 0.5, "width_mm": 8.0},
], ids=lambda keys: keys["shape"])  # fmt: skip
def test_a_deck_s_finger_is_the_one_that_is_pressed(finger, tmp_path):
    raw = load_scene("TI").model_dump() | {"indenter": finger}
    scene = Scene.model_validate(raw)
    lines = write_deck(scene, 32.0, 2.0, (), tmp_path / "any.inp").read_text().splitlines()
    start = lines.index("*NODE, NSET=FINGER") + 1
    stop = next(i for i in range(start, len(lines)) if lines[i].startswith("*"))
    nodes = 1e-3 * np.array([[float(v) for v in s.split(",")[1:]] for s in lines[start:stop]])
    underside = nodes[: (len(nodes)) // 3]  # then its back and what lies between
    gap, _, _ = finger_over(scene.indenter, 32e-3, 1e-3 * scene.surface_mm).gap(underside)
    np.testing.assert_allclose(gap, 0, atol=1e-11)
    assert np.ptp(underside[:, 0]) == pytest.approx(8e-3, rel=1e-3)


def written(pressed: Press, path: Path) -> list[Path]:
    pytest.importorskip("meshio", reason="meshio is not installed (extra: mesh)")
    return write_vtu(pressed.solved.body, pressed.solved.states, path)


def test_a_vtu_reads_back(tmp_path):
    pressed = press(load_scene("HAOT"), 32.0, 0.3, (80.0, 120.0), accuracy_pct=5)
    paths = written(pressed, tmp_path / "haot.vtu")
    assert [p.name for p in paths] == ["haot-0.vtu", "haot-1.vtu"]
    for path, state in zip(paths, pressed.states, strict=True):
        read = pytest.importorskip("meshio").read(path)
        np.testing.assert_allclose(read.points[:, :2], pressed.solved.picture.nodes_m)
        np.testing.assert_allclose(read.point_data["displacement_m"][:, :2], state.displacement_m)
        stress = read.point_data["von_mises_pa"]
        np.testing.assert_allclose(stress, pressed.solved.picture.von_mises_pa(state.solution))
        assert read.cell_data["det_f"][0].min() == pytest.approx(state.min_jacobian)
        assert set(np.unique(read.cell_data["region"][0])) == {1}


def test_a_vtu_of_one_state_keeps_the_name(tmp_path):
    pressed = press(load_scene("HAOT"), 32.0, 0.3, (80.0,), accuracy_pct=10)
    assert written(pressed, tmp_path / "one.vtu") == [tmp_path / "one.vtu"]


def test_a_solid_s_vtu_has_its_wedges_in_vtk_s_order(tmp_path):
    """Nodes in the middle of edges and faces, by the list of corners in VTK's File Formats."""
    scene = small_solid(16.0, 16.0, height_mm=6.0)
    pressed = press(scene, 8.0, 0.5, model="solid", accuracy_pct=50)
    (state,) = pressed.states
    (path,) = written(pressed, tmp_path / "solid.vtu")
    read = pytest.importorskip("meshio").read(path)
    (wedges,) = read.cells
    corners, middles = np.split(read.points[wedges.data], [6], axis=1)
    between = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
    between += [(0, 1, 3, 4), (1, 2, 4, 5), (2, 0, 5, 3)]
    expected = np.stack([corners[:, list(of)].mean(axis=1) for of in between], axis=1)
    np.testing.assert_allclose(middles, expected, atol=1e-9)
    np.testing.assert_allclose(read.point_data["displacement_m"], state.displacement_m)
    assert read.cell_data["det_f"][0].min() == pytest.approx(state.min_jacobian)
    assert read.point_data["von_mises_pa"].max() >= state.von_mises_pa > 0
