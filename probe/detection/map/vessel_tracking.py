"""Objects of neighbouring rows that are one: a vessel's course, and where it is stenosed."""

from dataclasses import replace

from probe.detection.finding import Kind, ObjectFinding

MAX_STRAY_PITCHES = 1.5
"""How far in pitches a course may move from row to row."""
MAX_MISSED_ROWS = 2
"""Rows in which it may be missed."""

Row = tuple[float, list[ObjectFinding]]
Chain = list[tuple[int, float, ObjectFinding]]


def across_rows(rows: list[Row], pitch_m: float) -> list[ObjectFinding]:
    """One object per course; ``rows`` are (y in m, its objects) in order of y.

    A course is a vessel if it pulses in any row: where it then is stenotic, or stiff without a
    pulse, is its stenosed stretch. An object that only one of many rows shows stays as it is.
    """
    if len(rows) == 1:
        return rows[0][1]
    chains: list[Chain] = []
    for number, (y_m, objects) in enumerate(rows):
        for one in sorted(objects, key=lambda o: -o.confidence):
            chain = _nearest(chains, number, one, pitch_m)
            if chain is None:
                chains.append([(number, y_m, one)])
            else:
                chain.append((number, y_m, one))
    return [_course(chain) for chain in chains]


def _nearest(chains: list[Chain], number: int, one: ObjectFinding, pitch_m: float) -> Chain | None:
    """The chain that goes on in this object; one that has none in this row yet."""
    reach = [
        (abs(chain[-1][2].position_m - one.position_m), chain)
        for chain in chains
        if 1 <= number - chain[-1][0] <= MAX_MISSED_ROWS
        and abs(chain[-1][2].position_m - one.position_m)
        <= MAX_STRAY_PITCHES * pitch_m * (number - chain[-1][0])
    ]
    return min(reach, key=lambda r: r[0])[1] if reach else None


def _course(chain: Chain) -> ObjectFinding:
    objects = [one for _, _, one in chain]
    vessel = [one for one in objects if one.kind in ("artery", "stenotic artery")]
    sick = [y for _, y, one in chain if one.kind in ("stenotic artery", "tumour")] if vessel else []
    kind = _kind(objects, bool(vessel), bool(sick))
    those = [one for one in objects if one.kind == kind] or objects
    clearest = max(those, key=lambda one: (one.confidence, abs(one.peak_pa)))
    return replace(
        clearest,
        kind=kind,
        course=tuple((one.position_m, y) for _, y, one in chain),
        stenosed_m=(min(sick), max(sick)) if sick else None,
    )


def _kind(objects: list[ObjectFinding], vessel: bool, sick: bool) -> Kind:
    if vessel:
        return "stenotic artery" if sick else "artery"
    return "tumour" if any(one.kind == "tumour" for one in objects) else "undecided"
