"""How deep, how large, how stiff: intervals that hold, and silence where nothing is known."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate
from probe.detection.beneath import explain
from probe.detection.beneath.posterior import Model, Posterior, sample
from sim_backend.scene.scene_file import Scene


def scanned(scene: Scene, folder: Path, noise_mn: float = 0.5) -> palpate.Finding:
    rig = palpate.default_rig(scene)
    quiet = rig.sensor[0].model_copy(update={"noise_mn": noise_mn})
    rig = rig.model_copy(update={"sensor": (quiet,)})
    run = palpate.scan(rig, scene=scene, seed=3, out=folder)
    return palpate.detect(run.path)


def test_a_lump_s_depth_and_diameter_hold_and_its_stiffness_is_bounded(tmp_path: Path) -> None:
    (lump,) = scanned(palpate.load_scene("TIT"), tmp_path).objects
    low_m, high_m = lump.sizes.depth_ci_m
    assert low_m < 12.66e-3 < high_m and high_m - low_m < 5e-3
    low_m, high_m = lump.sizes.diameter_ci_m
    assert low_m < 4.5e-3 < high_m and high_m - low_m < 2.5e-3
    low_pa, high_pa = lump.sizes.modulus_ci_pa
    assert low_pa < 1000e3 < high_pa
    said = lump.sizes.as_json()
    assert said["depth_mm"] == pytest.approx(1e3 * lump.sizes.depth_m)
    assert said["modulus_ci_kpa"][1] is None or said["modulus_ci_kpa"][1] > 1000


def test_a_posterior_that_was_sampled_badly_is_sampled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[float] = []

    def badly_once(*asked: Any) -> Posterior:
        posterior = sample(*asked)
        tried.append(posterior.effective)
        return replace(posterior, effective=1.0) if len(tried) == 1 else posterior

    monkeypatch.setattr(explain, "sample", badly_once)
    (lump,) = scanned(palpate.load_scene("TIT"), tmp_path).objects
    assert lump.sizes.depth_m is not None and len(tried) == 2


def test_a_lump_that_grew_is_larger_in_diameter_and_as_deep(tmp_path: Path) -> None:
    lump = palpate.load_scene("TIT")
    (small,) = lump.inclusion
    large = lump.model_copy(update={"inclusion": (small.model_copy(update={"diameter_mm": 6.5}),)})
    runs = []
    for scene, folder in ((lump, tmp_path / "first"), (large, tmp_path / "later")):
        palpate.scan(palpate.default_rig(scene), scene, folder, seed=1)
        runs += folder.glob("*.run")
    said = palpate.compare(*runs)
    _, low, high = said.objects[0].change["diameter"]
    assert low <= 6.5 / 4.5 - 1 <= high and low > 0
    _, shallower, deeper = said.objects[0].change["depth"]
    assert shallower <= 0 <= deeper
    assert "larger or harder in B" in said.reason and "mm in B" in said.reason


def test_a_vessel_s_depth_holds_and_its_narrowing_is_not_told(tmp_path: Path) -> None:
    (vessel,) = scanned(palpate.load_scene("TIHA"), tmp_path).objects
    low_m, high_m = vessel.sizes.depth_ci_m
    assert np.isnan(low_m) or low_m < 12.66e-3 < high_m
    assert "stenosis" in vessel.sizes.undecided
    assert vessel.sizes.as_json()["stenosis"] is None


def test_two_lumps_are_no_single_one(tmp_path: Path) -> None:
    scene = palpate.load_scene("TIT")
    lump = scene.inclusion[0]
    two = tuple(lump.model_copy(update={"x_mm": x, "depth_mm": 8.0}) for x in (26.0, 36.0))
    found = scanned(scene.model_copy(update={"name": "two", "inclusion": two}), tmp_path)
    for one in found.objects:
        low_m, high_m = one.sizes.depth_ci_m
        assert np.isnan(low_m) or low_m < 8e-3 < high_m


def test_what_stands_on_another_support_has_no_table(tmp_path: Path) -> None:
    scene = palpate.load_scene("TIT")
    sticks = scene.model_copy(
        update={"support": scene.support.model_copy(update={"contact": "bonded"})}
    )
    (lump,) = scanned(sticks, tmp_path).objects
    assert "no table" in lump.sizes.undecided["depth"]
    assert np.isnan(lump.sizes.depth_m) and lump.sizes.as_json()["depth_ci_mm"] is None


def test_samples_of_a_known_posterior_have_its_moments_and_evidence() -> None:
    """A Gaussian likelihood within a box: everything is known in closed form."""
    root = np.array([[4.0, 0.0], [3.0, 5.0]])
    at = np.array([0.3, -0.2])
    model = Model(
        np.full(2, -2.0), np.full(2, 2.0), lambda t: (t - at) @ root.T,
        lambda t: np.ones(len(t), bool), 0.0, np.array([[1.0, 1.0], [-1.0, 0.5]]),
    )  # fmt: skip
    got = sample(model, np.random.default_rng(0))
    covariance = np.linalg.inv(root.T @ root)
    np.testing.assert_allclose(got.weights @ got.points, at, atol=0.03)
    low, _, high = got.quantiles(got.points[:, 0])
    assert high - low == pytest.approx(2 * 1.96 * covariance[0, 0] ** 0.5, rel=0.1)
    inside = 2 * np.pi * np.linalg.det(covariance) ** 0.5 / 16
    assert got.log_evidence == pytest.approx(np.log(inside), abs=0.1)
    assert got.effective > 200
