"""VTU files read back as what was solved."""

from pathlib import Path

import numpy as np
import pytest

from sim_backend.fem.io.vtu import write_vtu
from sim_backend.models.press import Press, press
from sim_backend.scene.scene_file import load_scene

meshio = pytest.importorskip("meshio", reason="meshio is not installed (extra: mesh)")


def written(pressed: Press, path: Path) -> list[Path]:
    return write_vtu(pressed.solved.body, pressed.solved.states, path)


def test_reads_back(tmp_path):
    pressed = press(load_scene("HAOT"), 32.0, 0.3, (80.0, 120.0), accuracy_pct=5)
    paths = written(pressed, tmp_path / "haot.vtu")
    assert [p.name for p in paths] == ["haot-0.vtu", "haot-1.vtu"]
    for path, state in zip(paths, pressed.states, strict=True):
        read = meshio.read(path)
        np.testing.assert_allclose(read.points[:, :2], pressed.solved.picture.nodes_m)
        np.testing.assert_allclose(read.point_data["displacement_m"][:, :2], state.displacement_m)
        stress = read.point_data["von_mises_pa"]
        np.testing.assert_allclose(stress, pressed.solved.picture.von_mises_pa(state.solution))
        assert read.cell_data["det_f"][0].min() == pytest.approx(state.min_jacobian)
        assert set(np.unique(read.cell_data["region"][0])) == {1}


def test_one_state_keeps_the_name(tmp_path):
    pressed = press(load_scene("HAOT"), 32.0, 0.3, (80.0,), accuracy_pct=10)
    assert written(pressed, tmp_path / "one.vtu") == [tmp_path / "one.vtu"]
