"""What a pulse alone can say, where there is no row: a vessel, and out of tissue its health."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from probe.detection.classify.classifier import PULSE_BLUR, PULSE_FLOOR
from probe.detection.classify.population import lone_samples
from probe.detection.finding import Kind, ObjectFinding, stated
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.pulse.has_pulse import MIN_POSTERIOR
from probe.detection.pulse.presses import Press

Array = NDArray[np.float64]


def lone_vessel(presses: tuple[Press, ...], rows: list[list[int]]) -> ObjectFinding | None:
    """A vessel out of tissue: fewer presses than a row met it, those beside it met nothing.

    Healthy or stenotic is decided by its pulse over its force, against solved vessels that lie on a
    flat support: a stenosis holds the lumen open and hides nine tenths of the pulse. None where
    nothing beside it is empty, or where it does not pulse.
    """
    row = next((r for r in rows if any(not presses[i].touched for i in r)
                and any(presses[i].pulsing for i in r)), None)  # fmt: skip
    if row is None:
        return None
    met = [presses[i] for i in row if presses[i].pulse is not None]
    x_m = np.array([p.station.x_m for p in met])
    if len(np.unique(x_m)) >= MIN_STATIONS:
        return None
    level = np.array([max(p.level_pa, 0.0) for p in met])
    above = met[int(np.argmax(level))]
    assert above.pulse is not None
    share = shares(above.size_pa / above.level_pa, above.pulse.size_sd_pa / above.level_pa)
    best = max(share, key=lambda k: share[k])
    place = float(np.average(x_m, weights=level)) if level.sum() > 0 else above.station.x_m
    every = np.unique([presses[i].station.x_m for i in row])
    pitch = float(np.median(np.diff(every))) if len(every) > 1 else float("nan")
    chance = share[best] * _pulse(above)
    if chance < MIN_POSTERIOR:
        chances = ", ".join(f"{k} {100 * v:.0f} %" for k, v in share.items())
        return ObjectFinding(
            "undecided", place, (place - pitch, place + pitch), above.level_pa, above.size_pa,
            stated(chance), f"a vessel out of tissue, between {chances}: hold for more beats",
        )  # fmt: skip
    return ObjectFinding(
        best, place, (place - pitch, place + pitch), above.level_pa, above.size_pa, stated(chance),
        "it pulses and nothing lies beside it: a vessel out of tissue, judged by its pulse over "
        f"its force ({100 * above.size_pa / above.level_pa:.2g} %)",
    )  # fmt: skip


def shares(pulse: float, pulse_sd: float) -> dict[Kind, float]:
    """Posterior probability of each lone kind given its pulse over its force."""
    size = max(pulse, PULSE_FLOOR)
    blur = float(np.hypot(PULSE_BLUR, min(pulse_sd / size, 2.0)))
    score = {
        kind: float(logsumexp(-0.5 * ((np.log(size) - logs) / blur) ** 2) - np.log(len(logs)))
        for kind, logs in _lone().items()
    }
    whole = float(logsumexp(list(score.values())))
    return {kind: float(np.exp(value - whole)) for kind, value in score.items()}


def pulsing_place(presses: tuple[Press, ...], unfinished: bool) -> list[ObjectFinding]:
    """The one object that a pulse alone can show, where no row does: a vessel, sick or not."""
    pulsing = [p for p in presses if p.pulsing and p.pulse is not None]
    if not pulsing:
        return []
    clearest = min(pulsing, key=lambda p: p.pulse.p_value if p.pulse else 1.0)
    every = np.unique([p.station.x_m for p in presses if np.isfinite(p.station.x_m)])
    x_m = clearest.station.x_m
    reach = float(np.median(np.diff(every))) if len(every) > 1 else float("nan")
    low, high = x_m - reach, x_m + reach
    if len(every) > 1:
        low, high = max(low, float(every[0])), min(high, float(every[-1]))
    kind: Kind = "undecided" if unfinished and len(every) > 1 else "artery"
    reason = f"it pulses; whether it is stenosed needs a row of {MIN_STATIONS} stations over it"
    if kind == "undecided":
        reason = f"the row is not finished: {reason}"
    return [ObjectFinding(kind, x_m, (low, high), float("nan"), clearest.size_pa,
                          stated(_pulse(clearest)), reason)]  # fmt: skip


def _pulse(press: Press) -> float:
    """Posterior probability that what moves is a pulse; a reference beside it makes it one."""
    if press.cause is not None:
        return press.cause.pulse
    return 1 - min(1.0, press.pulse.p_value) if press.pulse else 0.0


@lru_cache(maxsize=1)
def _lone() -> dict[Kind, Array]:
    return {k: np.log(np.maximum(v, PULSE_FLOOR)) for k, v in lone_samples().items()}
