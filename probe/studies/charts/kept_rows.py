"""A chart's rows, which are not lost when it is broken off."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd


@contextmanager
def kept_rows(file: Path, say: Callable[[str], None]) -> Iterator[list[dict[str, Any]]]:
    """A list that is written to the CSV ``file`` at the end, also of what ends early."""
    rows: list[dict[str, Any]] = []
    try:
        yield rows
    except BaseException:
        if rows:
            say(f"{len(rows)} rows are kept in {file}")
        raise
    finally:
        if rows:
            file.parent.mkdir(parents=True, exist_ok=True)
            pd.DataFrame(rows).to_csv(file, index=False, float_format="%.5g")
