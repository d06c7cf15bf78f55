"""Two scans beside each other: which one shows disease."""

from math import isfinite, log

from scipy.stats import norm

from probe.detect.finding import Comparison, Diseased
from probe.detect.presses import Press, presses_of
from probe.recording import Recording

FALSE_ALARM = 0.01
SURE = 0.95


def compare(a: Recording, b: Recording) -> Comparison:
    """Which of two scans shows the diseased artery: the stiffer one with the weaker pulse.

    Each scan is represented by the station of its largest pulse. ``neither`` when stiffness and
    pulse are equal within their doubt, ``undecided`` when they contradict each other or no pulse
    is seen at all.
    """
    one, other = _clearest(a), _clearest(b)
    if one is None or other is None:
        which = "A" if one is None else "B"
        return _unknown(f"scan {which} has no press that can be judged")
    if min(_chance(one), _chance(other)) * 2 > FALSE_ALARM:
        return _unknown("neither scan has a pulse: hold for more beats, or press deeper")
    stiffer = _above(one.level_pa, one.level_sd_pa, other.level_pa, other.level_sd_pa)
    weaker = _above(other.size_pa, _size_sd(other), one.size_pa, _size_sd(one))
    diseased, confidence, reason = _judge(stiffer, weaker)
    peak_ratio, pulse_ratio = one.level_pa / other.level_pa, one.size_pa / other.size_pa
    return Comparison(diseased, peak_ratio, pulse_ratio, confidence, reason)


def _unknown(reason: str) -> Comparison:
    return Comparison("undecided", float("nan"), float("nan"), 0.0, reason)


def _judge(stiffer: float, weaker: float) -> tuple[Diseased, float, str]:
    """From the probabilities that A is stiffer, and that A's pulse is weaker."""
    if min(stiffer, weaker) >= SURE:
        return "A", stiffer * weaker, "A is stiffer and its pulse is weaker"
    if max(stiffer, weaker) <= 1 - SURE:
        return "B", (1 - stiffer) * (1 - weaker), "B is stiffer and its pulse is weaker"
    certain = [p for p in (stiffer, weaker) if not 1 - SURE < p < SURE]
    if not certain:
        even = 1 - abs(stiffer - 0.5) - abs(weaker - 0.5)
        return "neither", even, "stiffness and pulse are equal within what the two scans can tell"
    if len(certain) == 2:
        return "undecided", 0.5, "the stiffer one has the stronger pulse: not what stenosis does"
    which = "pulse" if 1 - SURE < weaker < SURE else "stiffness"
    reason = f"only one of the two differs, the {which} is equal within its doubt: hold longer"
    return "undecided", max(certain[0], 1 - certain[0]), reason


def _above(x: float, x_sd: float, y: float, y_sd: float) -> float:
    """Probability that x is above y, by the logarithm of their ratio."""
    if min(x, y) <= 0:
        return 0.5
    spread = ((x_sd / x) ** 2 + (y_sd / y) ** 2) ** 0.5
    return float(norm.cdf(log(x / y) / max(spread, 1e-12)))


def _clearest(recording: Recording) -> Press | None:
    judged = [p for p in presses_of(recording, FALSE_ALARM) if p.pulse and isfinite(p.level_pa)]
    if not judged:
        return None
    if min(_chance(p) for p in judged) * len(judged) <= FALSE_ALARM:
        return max(judged, key=lambda p: p.size_pa)
    return max(judged, key=lambda p: p.level_pa)


def _chance(press: Press) -> float:
    return press.pulse.p_value if press.pulse else 1.0


def _size_sd(press: Press) -> float:
    return press.pulse.size_sd_pa if press.pulse else float("nan")
