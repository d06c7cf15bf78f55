"""Break the source at random places, one place at a time: does a test of that file's room fail?

    python -m mutants --each 20                       20 places of every room, kept in docs/results
    python -m mutants --only drivers/grbl --out g.csv     of one room; prints survivors' differences

cosmic-ray walks the syntax tree and makes the changes (other operators, other numbers, conditions
negated, loops and decorators removed). A room is witnessed by the tests that mirror it:
`probe/scan` by `tests/probe/scan`. The tree is copied first; the working copy is not touched.
"""

import argparse
import os
import random
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from kept import ROOT, Row, fill

PACKAGES = ("probe", "drivers", "sim_backend", "calibration")
COPIED = (*PACKAGES, "palpate", "tests", "benchmarks", "rigs", "pyproject.toml", "README.md")
TIMEOUT_S = 300.0


@dataclass(frozen=True)
class Place:
    """One change that an operator of cosmic-ray would make in ``file``."""

    file: Path
    operator: str
    occurrence: int
    line: int


def witnesses(file: Path, root: Path = ROOT) -> tuple[Path, ...]:
    """Tests of a source file, both relative to ``root``: those of its name, then its room's.

    >>> witnesses(Path("probe/planning/plan.py"))[-1].as_posix()
    'tests/probe/planning'
    """
    mirror = Path("tests") / file.parent
    while not any((root / mirror).glob("**/test_*.py")):
        mirror = mirror.parent
    own = mirror / f"test_{file.stem}.py"
    return (own, mirror) if (root / own).exists() else (mirror,)


def rooms() -> dict[str, list[Path]]:
    """Source files by room: a package's folders, and a package's own files."""
    found: dict[str, list[Path]] = {}
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            relative = file.relative_to(ROOT)
            found.setdefault("/".join(relative.parts[:2][: len(relative.parts) - 1]), []).append(
                relative
            )
    return found


def places(files: list[Path]) -> Iterator[Place]:
    """Everything that could be changed in ``files``; annotations and docstrings stay."""
    from cosmic_ray.ast import ast_nodes, get_ast_from_path
    from cosmic_ray.plugins import get_operator, operator_names

    operators = [(name, get_operator(name)) for name in operator_names()]
    for file in files:
        tree = get_ast_from_path(ROOT / file)
        for name, operator in operators:
            if operator.arguments():  # names of variables, which nobody gave
                continue
            positions = (
                (node, start)
                for node in ast_nodes(tree)
                for start, _ in operator().mutation_positions(node)
            )
            for occurrence, (node, (line, _)) in enumerate(positions):
                if not _in_annotation(node):
                    yield Place(file, name, occurrence, line)


def _in_annotation(node: object) -> bool:
    """``int | None`` is no arithmetic."""
    while node is not None:
        if getattr(node, "type", "") in ("annassign", "tfpdef", "param", "decorator"):
            return True
        parent = getattr(node, "parent", None)
        if getattr(parent, "type", "") == "funcdef" and getattr(parent, "annotation", 0) is node:
            return True
        node = parent
    return False


def judged(room: str, file: str, operator: str, occurrence: int, line: int) -> Row:
    """Whether a witness fails once the place is changed; the difference, if none does."""
    from cosmic_ray.mutating import mutate_and_test
    from cosmic_ray.work_item import MutationSpec

    spec = MutationSpec(Path(file), operator, occurrence, (line, 0), (line, 1))
    tests = " ".join(str(test) for test in witnesses(Path(file)))
    command = f"{sys.executable} -m pytest -x -q -p no:cacheprovider --timeout 120 {tests}"
    result = mutate_and_test([spec], command, TIMEOUT_S)
    found = "noticed" if result.is_killed else "survived"
    print(found, room, f"{file}:{line}", operator, flush=True)
    if not result.is_killed:
        print(result.diff, flush=True)
    return {"found": found}


def copy_tree(into: Path) -> None:
    """The packages with their compiled files, first on the path of every witness."""
    for name in COPIED:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, into / name)


def main() -> None:
    """Draw, break, ask; what was broken off goes on."""
    parser = argparse.ArgumentParser(prog="mutants", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--each", type=int, default=20, help="places of every room")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="rooms whose name holds this")
    parser.add_argument("--out", type=Path, default=ROOT / "docs/results/mutants.csv")
    given = parser.parse_args()
    jobs = []
    for room, files in rooms().items():
        if given.only in room:
            can_break = list(places(files))
            draw = random.Random(f"{room} {given.seed}")
            drawn = draw.sample(can_break, min(given.each, len(can_break)))
            jobs += [(room, str(p.file), p.operator, p.occurrence, p.line) for p in drawn]
    with TemporaryDirectory(prefix="palpate-mutants-") as folder:
        copy_tree(Path(folder))
        os.chdir(folder)
        os.environ |= {"PYTHONPATH": folder, "QT_QPA_PLATFORM": "offscreen"}
        keys = ("room", "file", "operator", "occurrence", "line")
        fill(given.out.resolve(), keys, ("found",), jobs, judged)


if __name__ == "__main__":
    main()
