"""What data do not determine, from a fit's covariance and residuals, in words."""

import numpy as np

from calibration.fit import Array, Fit

MAX_RELATIVE_ERROR = 0.2  # a relative standard error beyond which a value is a guess
MAX_CORRELATION = 0.97  # a correlation beyond which two values are one
MAX_TREND_SIGMAS = 4.0  # standard deviations of the residuals' lag-one correlation


def limits_of(
    fit: Fit, tau_s: Array, spacing_s: float, length_s: float
) -> tuple[bool, tuple[str, ...]]:
    """Is the model adequate, and what do the data leave open?

    ``tau_s``: relaxation times fitted from a record of ``length_s`` sampled every ``spacing_s``.
    """
    said = [
        "Poisson's ratio: one indenter's force cannot separate it from the modulus; it is given"
    ]
    for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True):
        logarithmic = name.startswith("log ")
        error = sigma if logarithmic else sigma / abs(value) if value else np.inf
        if name.startswith("g ") and abs(value) < 2 * sigma:
            said.append(f"{name}: not distinguishable from 0; use fewer relaxation terms")
        elif error > MAX_RELATIVE_ERROR and name != "surface":
            said.append(f"{name.removeprefix('log ')}: known only to {100 * error:.0f} %")
    scale = np.outer(fit.sigma, fit.sigma)
    correlation = fit.covariance / np.where(scale > 0, scale, 1.0)
    for i, j in zip(*np.nonzero(np.triu(np.abs(correlation), 1) > MAX_CORRELATION), strict=True):
        one, other = (fit.names[n].removeprefix("log ") for n in (i, j))
        said.append(
            f"{one} and {other} separately (correlation {correlation[i, j]:+.3f}): "
            "fix one of them from another measurement"
        )
    for n, tau in enumerate(tau_s.tolist()):
        if tau > 2 * length_s:
            said.append(f"tau {n} = {tau:.2g} s: longer than twice the record; hold longer")
        elif tau < 2 * spacing_s:
            said.append(f"tau {n} = {tau:.2g} s: below two sample intervals; sample faster")
    if not tau_s.size:
        said.append("relaxation: none was fitted; the modulus belongs to this rate of pressing")
    r = fit.residuals
    power = float(r @ r)
    lag = float(r[1:] @ r[:-1]) / power if power > 0 else 0.0
    adequate = lag * np.sqrt(len(r)) < MAX_TREND_SIGMAS
    if not adequate:
        said.append(
            "layers, inclusions or a wrong rig stiffness: the residuals follow a trend "
            f"(lag-one correlation {lag:.2f}), so this model does not describe the block"
        )
    return bool(adequate), tuple(said)
