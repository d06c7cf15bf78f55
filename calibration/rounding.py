"""Level and drift of readings that a sensor rounds more coarsely than its noise.

Rounding's error is no noise there: at a noise of 0.2 steps the mean of any number of readings is
off by up to (step / pi) exp(-2 pi^2 0.2^2) = 0.14 steps (Widrow and Kollar 2008, Quantization
Noise, chapter 4). What such readings do say is between which bounds each true value lay.
"""

import numpy as np

from calibration.fit import BATCHES, Array, Fit

DITHERED = 0.6
"""Standard deviation of readings over their step, from which on a mean is as good: their noise is
0.53 steps by then, where means are off by 0.1 % of a step."""
NOISES = np.geomspace(0.03, 1.0, 48)
"""Standard deviations of the noise that are tried, in steps; neighbours are 8 % of one another, as
near as 300 readings tell them from each other."""
SAME = 1e-9
"""Of the largest reading: numbers nearer than this differ by the computer's rounding alone."""
SINES = 8
"""Of the sawtooth that rounding adds: further ones are a tenth of the first, or less."""
EVEN = 0.01
"""Of a step: what distinct readings may be off its multiples."""


def step_of(readings: Array) -> float:
    """The step of ``readings`` (n,): the least difference between two, where all others are
    multiples of it; 0 where they are not."""
    levels = np.unique(readings)
    gaps = np.diff(levels)
    gaps = gaps[gaps > SAME * float(np.abs(levels).max())]
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    codes = (levels - levels[0]) / step
    return step if np.abs(codes - np.round(codes)).max() < EVEN else 0.0


def rounding_error(level: Array, step: float, noise: float) -> Array:
    """What rounding to multiples of ``step`` adds on average to ``level`` (n,), all in one unit,
    under normal noise of this standard deviation (Widrow and Kollar, as above)."""
    if not step:
        return np.zeros(len(level))
    if not noise:
        return np.asarray(step * np.round(level / step) - level)
    order = np.arange(1, SINES + 1)
    left = np.exp(-2 * (np.pi * order * noise / step) ** 2)
    size = (-1.0) ** order * step / (np.pi * order) * left
    return np.asarray(np.sin(2 * np.pi * np.outer(level / step, order)) @ size)


def unrounded(fit: Fit, design: Array, readings: Array) -> Fit:
    """``fit`` of ``design`` (n, p) to ``readings`` (n,), or, where they are rounded more coarsely
    than their noise, the estimates for which the bounds that each reading gives are most likely.

    For each of `NOISES` these are found by maximum likelihood of rounded normal readings; the
    estimates are their mean, weighted by that likelihood, and the covariance is that of their
    Fisher information plus their own spread: where two codes alone occur, the readings do not say
    how large the noise is, and so not how far from the edge between the two the level lies. What
    `fit` was widened by, for readings that follow one another, the information's part is, too.

    How often 95 % intervals of a tare's bias hold, and of its drift of a five-hundredth of a step a
    second, of 200 draws each of 600 readings at 10 Hz (in brackets by least squares alone, of 60);
    below a noise of 0.15 steps readings may never change, and those draws are left out:

        noise [steps]   bias           drift          half of the bias' interval [steps]
        0.1             100 (9) %      99 (27) %      0.158 (0.025)
        0.15            100 (9) %      98 (45) %      0.157 (0.028)
        0.2              98 (17) %     94 (70) %      0.078 (0.031)
        0.3              93 (52) %     90 (95) %      0.040 (0.037)
        0.4              96 (93) %     96 (97) %      0.042 (0.043)
        0.2, lag 0.9     92 (47) %     97 (88) %      0.133 (0.108)
    """
    step = step_of(readings)
    if not step or fit.noise > DITHERED * step:
        return fit
    rows, codes, counts = _counted(design, readings / step)
    start = fit.values / step
    found = []
    for noise in NOISES[::-1]:
        start, information, height = _likeliest(rows, codes, counts, noise, start)
        found.append((start, np.linalg.inv(information), height))
    estimates, own, heights = (np.array(part) for part in zip(*found, strict=True))
    weight = NOISES[::-1] * np.exp(heights - heights.max())  # any noise is as likely beforehand
    weight /= weight.sum()
    mean = weight @ estimates
    spread = estimates - mean
    plain = fit.noise**2 * np.linalg.inv(design.T @ design)
    wider = max(float((np.diag(fit.covariance) / np.diag(plain)).max()), 1.0)
    covariance = wider * np.tensordot(weight, own, 1) + (weight * spread.T) @ spread
    values = mean * step
    return Fit(
        fit.names,
        values,
        covariance * step**2,
        readings - design @ values,
        fit.dof,
        fit.leverage,
    )


def _counted(design: Array, codes: Array) -> tuple[Array, Array, Array]:
    """Mean rows of `BATCHES` batches, the codes read in each, and how often."""
    batch = np.arange(len(codes)) * min(BATCHES, len(codes)) // len(codes)
    pairs, counts = np.unique(np.column_stack([batch, codes]), axis=0, return_counts=True)
    size = np.bincount(batch)
    means = np.column_stack([np.bincount(batch, column) / size for column in design.T])
    return means[pairs[:, 0].astype(int)], pairs[:, 1], counts.astype(float)


def _likeliest(
    rows: Array, codes: Array, counts: Array, noise: float, start: Array
) -> tuple[Array, Array, float]:
    """Values (p,) in steps, their information (p, p) and the log likelihood, by Newton's method:
    it is concave in them."""
    values, best = start, _bounded(rows, codes, counts, noise, start)
    for _ in range(50):
        log_likelihood, slope, information = best
        way, share = np.linalg.solve(information, slope), 1.0
        while share > 1e-4:
            there = _bounded(rows, codes, counts, noise, values + share * way)
            if there[0] >= log_likelihood:
                break
            share /= 2
        else:
            break
        values, best = values + share * way, there
        if there[0] - log_likelihood < 1e-6:
            break
    return values, best[2], best[0]


def _bounded(
    rows: Array, codes: Array, counts: Array, noise: float, values: Array
) -> tuple[float, Array, Array]:
    """Log likelihood that each reading rounds to its code, its slope, and its curvature negated."""
    from scipy.special import log_ndtr

    off = np.abs(codes - rows @ values)
    side = np.sign(codes - rows @ values)
    near, far = (off - 0.5) / noise, (off + 0.5) / noise
    log_chance = log_ndtr(-near) + np.log1p(-np.exp(log_ndtr(-far) - log_ndtr(-near)))
    density = [np.exp(-0.5 * edge**2 - log_chance) / np.sqrt(2 * np.pi) for edge in (near, far)]
    pull = density[0] - density[1]
    bend = np.maximum(pull**2 - (near * density[0] - far * density[1]), 0.0)
    slope = rows.T @ (counts * side * pull) / noise
    information = (rows.T * (counts * bend)) @ rows / noise**2
    return float(counts @ log_chance), slope, information
