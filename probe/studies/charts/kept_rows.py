"""A chart's rows, which are not lost when it is broken off."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd

Row = dict[str, Any]


@contextmanager
def kept_rows(
    file: Path, say: Callable[[str], None], begun: Sequence[Row] = ()
) -> Iterator[list[Row]]:
    """A list, at first of what was ``begun``, that is written to the CSV ``file`` at the end, also
    of what ends early."""
    rows = list(begun)
    try:
        yield rows
    except BaseException:
        if rows:
            say(f"{len(rows)} rows are kept in {file}")
        raise
    finally:
        if rows:
            write_rows(file, rows)


def write_rows(file: Path, rows: Sequence[Row]) -> None:
    """All of them, in place of what ``file`` held: in one piece, or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    pd.DataFrame(rows).to_csv(part, index=False, float_format="%.5g")
    part.replace(file)


def rows_of(file: Path) -> list[Row]:
    """What ``file`` holds; nothing where there is none."""
    if not file.exists():
        return []
    table = pd.read_csv(file, dtype={"value": str, "key": str})
    words = table.select_dtypes(exclude="number").columns
    table[words] = table[words].fillna("")
    return [{str(k): v for k, v in row.items()} for row in table.to_dict("records")]
