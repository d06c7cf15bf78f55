"""What the constants of `drivers.core.timestamps` matter: each is halved and doubled.

    python benchmarks/time_stamps.py

Frames without a time of their own: 44 streams of 100 and 1000 Hz, up to 2 % off their nominal rate,
with jitter of 1 and 4 ms, polled or not, with and without three lost frames, and a reader that
stands for 60 ms now and then. Printed are the error of the times and how many streams are counted
wrongly. Samples with a time: seven streams of 500 Hz whose clock loses 0 to 200 ms, of which three
(20, 50, 200 ms) are to be noticed; printed are how many stops of the clock were found in each, and
the greatest error after it.
"""

from collections.abc import Callable

import numpy as np

from drivers.core import timestamps
from drivers.core.arrays import Array
from drivers.core.timestamps import DeviceTime, FrameTime

OF_FRAMES = (
    "BLOCK_READS", "LATE_PERIODS", "PERIOD_SLACK", "PERIOD_BLOCKS", "PERIOD_LAG", "OFFSET_BLOCKS",
)  # fmt: skip
OF_DEVICES = ("DRIFT", "STOOD_S", "MAX_LATENESS_SPREAD", "LASTING_S", "INSTANT_S")
STALL_S = 0.06
Frames = tuple[float, float, float, float, int, int, int]
FRAMES: list[Frames] = [
    (100.0, off, jitter_s, poll_s, lost, 4000, seed)
    for off in (-0.02, 0.0, 0.02)
    for jitter_s, poll_s in ((0.001, 0.0), (0.004, 0.0), (0.001, 0.016))
    for lost in (0, 3)
    for seed in (1, 2)
] + [
    (1000.0, off, 0.001, poll_s, lost, 12000, 1)
    for off in (0.0, 0.01)
    for poll_s in (0.0, 0.004)
    for lost in (0, 3)
]
# seconds that the clock loses, jitter, when the reader stalls, the clock's drift, a busy second
Stops = tuple[float, float, tuple[float, ...], float, bool]
STOPS: list[Stops] = [
    (0.0, 0.001, (1.5, 2.0, 7.0), 1e-4, False), (0.0, 0.004, (), -1e-4, False),
    (0.0, 0.001, (), 0.0, True), (0.004, 0.001, (), 0.0, False),
    (0.02, 0.001, (3.0, 8.0), 1e-4, False), (0.05, 0.001, (3.0, 8.0), 0.0, False),
    (0.2, 0.004, (3.0, 8.0), 0.0, False),
]  # fmt: skip


def main() -> None:
    """Print a line per constant and value."""
    for names, show in ((OF_FRAMES, frames_in_words), (OF_DEVICES, stops_in_words)):
        print(f"{'as is':30s} {show()}")
        for name in names:
            _vary(name, show)


def _vary(name: str, show: Callable[[], str]) -> None:
    usual = getattr(timestamps, name)
    for factor in (0.5, 2.0):
        value = round(usual * factor) if isinstance(usual, int) else usual * factor
        if name == "LATE_PERIODS":
            value = min(value, 0.9)
        setattr(timestamps, name, value)
        print(f"{name + f' = {value:g}':30s} {show()}")
    setattr(timestamps, name, usual)


def frames_in_words() -> str:
    """Over all streams of frames."""
    rows = np.array([_frames(stream) for stream in FRAMES])
    wrong = int((rows[:, 1] != 0).sum())
    return f"rms {np.median(rows[:, 0]):.2f} ms (median), {wrong} of {len(rows)} counted wrongly"


def stops_in_words() -> str:
    """Of each stream with a time of its own."""
    found = [_stops(stream, seed) for seed, stream in enumerate(STOPS)]
    return ", ".join(f"{stops} stops {most_ms:.1f} ms" for stops, most_ms in found)


def _frames(stream: Frames) -> tuple[float, int]:
    rate_hz, off, jitter_s, poll_s, lost, n, seed = stream
    rng = np.random.default_rng(seed)
    true_s = (1 + off) / rate_hz * np.arange(1, n + 1)
    arrival_s = _stalled(true_s + rng.exponential(jitter_s, n), np.arange(1.3, true_s[-1], 3.1))
    if poll_s:
        arrival_s = np.ceil(arrival_s / poll_s) * poll_s
    sent = np.delete(np.arange(n), slice(n // 2, n // 2 + lost))
    time = FrameTime(1 / rate_hz)
    stamped = [time.stamp(float(at_s)) for at_s in arrival_s[sent]]
    error_s = (np.array([t for t, _ in stamped]) - true_s[sent])[300:]
    return 1e3 * float(np.std(error_s)), sum(missing for _, missing in stamped) - lost


def _stops(stream: Stops, seed: int) -> tuple[int, float]:
    lost_s, jitter_s, stalls_s, drift, busy = stream
    rng, n = np.random.default_rng(seed), 10000
    device_s = 0.002 * np.arange(n)
    true_s = device_s + np.where(np.arange(n) >= n // 2, lost_s, 0.0)
    arrival_s = true_s + 0.003 + rng.exponential(jitter_s, n)
    if busy:
        late = (true_s > 6) & (true_s < 7)
        arrival_s[late] += rng.uniform(0.015, 0.06, late.sum())
    arrival_s = _stalled(arrival_s, np.array(stalls_s))
    time, stamped, stops = DeviceTime(0.003, timestamps.DRIFT, stands_still=True), [], 0
    for one_s, at_s in zip(device_s * (1 + drift), arrival_s, strict=True):
        stamped.append(time.stamp(float(one_s), float(at_s)))
        stops += time.jumped_s > 0
    error_s = np.abs(np.array(stamped) - true_s)[n // 2 + 1000 :]
    return stops, 1e3 * float(error_s.max())


def _stalled(arrival_s: Array, stalls_s: Array) -> Array:
    """What arrives while the reader stands is read at the end of it, in order."""
    for begin_s in stalls_s:
        arrival_s[(arrival_s > begin_s) & (arrival_s < begin_s + STALL_S)] = begin_s + STALL_S
    return np.maximum.accumulate(arrival_s)


if __name__ == "__main__":
    main()
