"""FElupe, which shares nothing with our solver but the mesh, gives the same press."""

import pytest

from probe.studies.charts.peers import felupe_forces
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # FElupe's use of its dependencies
def test_felupe_agrees_on_force_and_pulse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where it takes few of the cells at once, as it does of finer meshes."""
    felupe = pytest.importorskip("felupe")
    monkeypatch.setattr(felupe.NeoHooke, "chunksize", 256, raising=False)
    scene = load_scene("TIHA").model_copy(update={"plane": "strain"})
    place = 32e-3, 1e-3, [80 * PA_PER_MMHG, 120 * PA_PER_MMHG], 2e-3
    theirs, _ = felupe_forces(scene, *place)
    _, found = solve_finite(scene, *place, "Q4M")
    ours = [one.force_n_per_m for one in found]
    assert ours == pytest.approx(theirs, rel=2e-3)
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], rel=0.02)


def test_plane_stress_is_not_compared() -> None:
    pytest.importorskip("felupe")
    with pytest.raises(ValueError, match="plane strain"):
        felupe_forces(load_scene("TIHA"), 32e-3, 1e-3, [0.0], 2e-3)
