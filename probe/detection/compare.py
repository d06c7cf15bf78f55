"""Two scans beside each other: which one shows disease."""

from math import isfinite, log, nan
from os import PathLike

from scipy.special import ndtr

from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.recording import Recording
from probe.detection.finding import Comparison, Diseased, stated
from probe.detection.pulse.presses import Press, presses_of
from probe.storage.run import recording_of

MIN_POSTERIOR = 0.95


def compare(a: Recording | str | PathLike[str], b: Recording | str | PathLike[str]) -> Comparison:
    """Which of two scans shows the diseased artery: the stiffer one with the weaker pulse.

    ``a`` and ``b`` are recordings, runs or run files. Each scan is represented by the station of
    its largest pulse. ``neither`` when stiffness and pulse are equal within their doubt,
    ``undecided`` when they contradict each other or no pulse is seen at all.

    Parameters
    ----------
    a
        A recording, a run or a run file.
    b
        The other one.

    Returns
    -------
    Comparison
        What differs, and how sure that is.

    Raises
    ------
    RunFileError
        The file cannot be read, or is no run.

    Examples
    --------
    >>> import palpate
    >>> recording = palpate.open_run("TIHA.run").recording()
    >>> palpate.compare(recording, recording).reason  # of one scan with itself
    'stiffness and pulse are equal within what the two scans can tell'
    """
    presses = [presses_of(recording_of(scan), DEFAULT_FALSE_ALARM / 2) for scan in (a, b)]
    one, other = (_clearest(some) for some in presses)
    if one is None or other is None:
        which = "A" if one is None else "B"
        return _unknown(f"scan {which} has no press that can be judged")
    for which, press in (("A", one), ("B", other)):
        if press.level_pa <= 0:
            return _unknown(
                f"scan {which} reads no force above zero where it presses, so that stiffness does "
                "not compare: turn its sign, or take the zero in the air"
            )
    if not any(press.pulsing for some in presses for press in some):
        return _unknown("neither scan has a pulse: hold for more beats, or press deeper")
    stiffer = _above(one.level_pa, one.level_sd_pa, other.level_pa, other.level_sd_pa)
    weaker = _above(other.size_pa, _size_sd(other), one.size_pa, _size_sd(one))
    diseased, confidence, reason = _judge(stiffer, weaker)
    ratios = _ratio(one.level_pa, other.level_pa), _ratio(one.size_pa, other.size_pa)
    return Comparison(diseased, *ratios, stated(confidence), reason)


def _ratio(x: float, y: float) -> float:
    """NaN where either is no size: a level in the noise about 0 has no ratio."""
    return x / y if min(x, y) > 0 else nan


def _unknown(reason: str) -> Comparison:
    return Comparison("undecided", nan, nan, 0.0, reason)


def _judge(stiffer: float, weaker: float) -> tuple[Diseased, float, str]:
    """From the probabilities that A is stiffer, and that A's pulse is weaker."""
    if min(stiffer, weaker) >= MIN_POSTERIOR:
        return "A", stiffer * weaker, "A is stiffer and its pulse is weaker"
    if max(stiffer, weaker) <= 1 - MIN_POSTERIOR:
        return "B", (1 - stiffer) * (1 - weaker), "B is stiffer and its pulse is weaker"
    certain = [p for p in (stiffer, weaker) if not 1 - MIN_POSTERIOR < p < MIN_POSTERIOR]
    if not certain:
        even = 1 - abs(stiffer - 0.5) - abs(weaker - 0.5)
        return "neither", even, "stiffness and pulse are equal within what the two scans can tell"
    if len(certain) == 2:
        return "undecided", 0.5, "the stiffer one has the stronger pulse: not what stenosis does"
    which = "pulse" if 1 - MIN_POSTERIOR < weaker < MIN_POSTERIOR else "stiffness"
    reason = f"only one of the two differs, the {which} is equal within its doubt: hold longer"
    return "undecided", max(certain[0], 1 - certain[0]), reason


def _above(x: float, x_sd: float, y: float, y_sd: float) -> float:
    """Probability that x is above y, by the logarithm of their ratio; even where one is no size."""
    if min(x, y) <= 0:
        return 0.5
    spread = ((x_sd / x) ** 2 + (y_sd / y) ** 2) ** 0.5
    return float(ndtr(log(x / y) / max(spread, 1e-12)))


def _clearest(presses: tuple[Press, ...]) -> Press | None:
    """The press of the largest pulse, or where none is seen, of the largest stress."""
    judged = [p for p in presses if p.pulse and isfinite(p.level_pa)]
    if any(p.pulsing for p in judged):
        return max(judged, key=lambda p: p.size_pa)
    return max(judged, key=lambda p: p.level_pa, default=None)


def _size_sd(press: Press) -> float:
    return press.pulse.size_sd_pa if press.pulse else nan
