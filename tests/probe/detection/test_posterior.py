"""Posteriors by their modes and by sampling, against closed forms."""

import numpy as np
import pytest

from probe.detection.beneath.posterior import Model, laplace, sample


def test_where_nothing_that_fits_is_possible_there_are_no_samples() -> None:
    model = Model(
        np.zeros(1), np.ones(1), lambda theta: 1e3 * (theta - 0.9),
        lambda theta: theta[:, 0] < 0.5, 0.0, np.array([[0.8]]),
    )  # fmt: skip
    posterior = sample(model, laplace(model), np.random.default_rng(0))
    assert posterior.effective == 0 and posterior.log_evidence == -np.inf


def test_samples_of_a_known_posterior_have_its_moments_and_evidence() -> None:
    """A Gaussian likelihood within a box: everything is known in closed form."""
    root = np.array([[4.0, 0.0], [3.0, 5.0]])
    at = np.array([0.3, -0.2])
    model = Model(
        np.full(2, -2.0), np.full(2, 2.0), lambda t: (t - at) @ root.T,
        lambda t: np.ones(len(t), bool), 0.0, np.array([[1.0, 1.0], [-1.0, 0.5]]),
    )  # fmt: skip
    got = sample(model, laplace(model), np.random.default_rng(0))
    covariance = np.linalg.inv(root.T @ root)
    np.testing.assert_allclose(got.weights @ got.points, at, atol=0.03)
    low, _, high = got.quantiles(got.points[:, 0])
    assert high - low == pytest.approx(2 * 1.96 * covariance[0, 0] ** 0.5, rel=0.1)
    inside = 2 * np.pi * np.linalg.det(covariance) ** 0.5 / 16
    assert got.log_evidence == pytest.approx(np.log(inside), abs=0.1)
    assert got.effective > 200
    fit = laplace(model)
    np.testing.assert_allclose(fit.best, at, atol=0.02)  # the box's prior draws it inwards
    assert fit.log_evidence == pytest.approx(np.log(inside), abs=0.3)
