"""Objects of neighbouring rows linked to one vessel: its path, and where it is stenosed."""

from dataclasses import replace

from probe.detection.classify.kinds import MIN_POSTERIOR
from probe.detection.finding import (
    HEALTHY,
    LUMP,
    NARROWED,
    UNDECIDED,
    Kind,
    ObjectFinding,
)

MAX_STRAY_PITCHES = 1.5
"""How far in pitches a course may move from row to row."""
MAX_MISSED_ROWS = 2
"""Rows in which it may be missed."""

Row = tuple[float, list[ObjectFinding]]
Chain = list[tuple[int, float, ObjectFinding]]


def across_rows(rows: list[Row], pitch_m: float) -> list[ObjectFinding]:
    """One object per course; ``rows`` are (y in m, its objects) in order of y.

    A course is a vessel if it pulses in any row. Where it then is stenotic, or likelier than
    `MIN_POSTERIOR` no healthy vessel, is its stenosed stretch, with the rows beside it that show
    nothing. A vessel that any row leaves in doubt is undecided. An object that only one of many
    rows shows stays as it is.
    """
    if len(rows) == 1:
        return rows[0][1]
    chains: list[Chain] = []
    for number, (y_m, objects) in enumerate(rows):
        for thing in sorted(objects, key=lambda o: -o.confidence):
            chain = _nearest(chains, number, thing, pitch_m)
            if chain is None:
                chains.append([(number, y_m, thing)])
            else:
                chain.append((number, y_m, thing))
    return [_course(chain, [y_m for y_m, _ in rows]) for chain in chains]


def _nearest(
    chains: list[Chain], number: int, thing: ObjectFinding, pitch_m: float
) -> Chain | None:
    """The chain that goes on in this object; one that has none in this row yet."""
    reach = [
        (abs(chain[-1][2].position_m - thing.position_m), chain)
        for chain in chains
        if 1 <= number - chain[-1][0] <= 1 + MAX_MISSED_ROWS
        and abs(chain[-1][2].position_m - thing.position_m)
        <= MAX_STRAY_PITCHES * pitch_m * (number - chain[-1][0])
    ]
    return min(reach, key=lambda r: r[0])[1] if reach else None


def _course(chain: Chain, rows_m: list[float]) -> ObjectFinding:
    """``rows_m`` are all rows' y [m]."""
    course = tuple((thing.position_m, y_m) for _, y_m, thing in chain)
    vessel = [thing for _, _, thing in chain if thing.is_vessel]
    if not vessel:
        kind: Kind = LUMP if any(o.kind == LUMP for _, _, o in chain) else UNDECIDED
        return replace(_clearest([o for _, _, o in chain if o.kind == kind]), course=course)
    sure = max(thing.confidence for thing in vessel)
    diseased = {number: _diseased(thing) for number, _, thing in chain}
    sick = [
        replace(thing, kind=NARROWED, reason="",
                confidence=thing.confidence if thing.kind == NARROWED else sure * p)
        for number, _, thing in chain if (p := diseased[number]) >= MIN_POSTERIOR
    ]  # fmt: skip
    if sick:
        stretch = _stretch([n for n, p in diseased.items() if p >= MIN_POSTERIOR], set(diseased))
        ends = rows_m[stretch[0]], rows_m[stretch[1]]
        return replace(_clearest(sick), course=course, stenosed_m=ends)
    whole_vessel = replace(_clearest(vessel), course=course)
    missed = set(range(chain[0][0], chain[-1][0])) - set(diseased)
    doubtful = sorted(missed | {n for n, p in diseased.items() if p > 1 - MIN_POSTERIOR})
    if not doubtful:
        return whole_vessel
    where = ", ".join(f"{1e3 * rows_m[n]:.1f}" for n in doubtful)
    return whole_vessel.undecided(
        f"a vessel that beats less or not at all at y = {where} mm: stenosed or deeper there; hold "
        "longer there"
    )


def _diseased(thing: ObjectFinding) -> float:
    """Probability that a vessel, known as one from other rows, is stenosed in this one."""
    known: dict[Kind, float] = {HEALTHY: 0.0, NARROWED: 1.0, LUMP: 1.0}
    return known.get(thing.kind, thing.diseased)


def _stretch(sick: list[int], seen: set[int]) -> tuple[int, int]:
    """The first and last row of a stretch, with rows beside it in which nothing was ``seen``."""
    first, last = min(sick), max(sick)
    while first - 1 not in seen and first > min(seen):
        first -= 1
    while last + 1 not in seen and last < max(seen):
        last += 1
    return first, last


def _clearest(objects: list[ObjectFinding]) -> ObjectFinding:
    return max(objects, key=lambda thing: (thing.confidence, abs(thing.peak_pa)))
