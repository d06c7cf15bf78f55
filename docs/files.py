"""Writes docs/reference/files.md: every file of the code in one sentence, its docstring's first.

python docs/files.py [--print]
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "files.md"
PACKAGES = ("palpate", "probe", "drivers", "sim_backend", "calibration")


def sentence(file: Path) -> str:
    """The first of the docstring, in one line of a table."""
    said = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    first = re.split(r"(?<=[.?!])\s", " ".join(said.partition("\n\n")[0].split()))[0]
    return first.replace("|", "\\|").replace("``", "`")


def page() -> str:
    """The page: a table for each folder, the folder's own sentence first."""
    return "\n".join(
        ["# Every file in a sentence", "",
         "Made by `python docs/files.py` from the files' own docstrings; a test compares.", "",
         *lines()]
    )  # fmt: skip


def lines() -> Iterator[str]:
    for package in PACKAGES:
        for init in sorted((ROOT / package).rglob("__init__.py")):
            folder = init.parent
            yield f"## {folder.relative_to(ROOT).as_posix()}\n\n{sentence(init)}\n"
            files = [f for f in sorted(folder.glob("*.py")) if not f.name.startswith("__")]
            if files:
                yield "| file | |\n|---|---|"
                yield from (f"| `{file.name}` | {sentence(file)} |" for file in files)
                yield ""


if __name__ == "__main__":
    if "--print" in sys.argv:
        sys.stdout.write(page())
    else:
        PAGE.write_text(page(), encoding="utf-8")
