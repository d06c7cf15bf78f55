"""A test uses what its own room offers or hides, and of other rooms only what they offer."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from paths import ROOT

PACKAGES = ("palpate", "probe", "drivers", "sim_backend", "calibration", "benchmarks")
ONE_ROOM = ("drivers", "calibration", "palpate", "benchmarks")
PROTOCOLS = {"_repr_html_", "_replace", "_asdict", "_fields"}
"""Of Jupyter and of named tuples: not private, whatever they look like."""
TESTS = sorted((ROOT / "tests").rglob("*.py"))


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in PROTOCOLS


def room(path: Path) -> tuple[str, ...]:
    """Package and room of a file, or of the tests that mirror it; devices are one room."""
    parts = [part for part in path.relative_to(ROOT).with_suffix("").parts if part != "tests"]
    return tuple(parts[:1] if parts[0] in ONE_ROOM else parts[:2])


@cache
def homes() -> dict[str, set[tuple[str, ...]]]:
    """The rooms that define each private name."""
    found: dict[str, set[tuple[str, ...]]] = {}
    for file in (file for package in PACKAGES for file in (ROOT / package).rglob("*.py")):
        for name in filter(is_private, defined(ast.parse(file.read_text("utf-8")))):
            found.setdefault(name, set()).add(room(file))
    return found


@cache
def supported() -> set[str]:
    """What tests share is every test's own."""
    files = (ROOT / "tests" / "support").glob("*.py")
    return {name for file in files for name in defined(ast.parse(file.read_text("utf-8")))}


def defined(tree: ast.Module) -> Iterator[str]:
    """Functions, classes, variables and attributes that a file makes."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name


def used(tree: ast.Module) -> Iterator[str]:
    """Private names that a test imports, asks an object for, or names in a string to be patched."""
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(names=names):
                yield from (one.name for one in names)
            case ast.Attribute(attr=name):
                yield name
            case ast.Call(func=ast.Attribute(attr="setattr" | "delattr"), args=arguments):
                strings = [one.value for one in arguments if isinstance(one, ast.Constant)]
                yield from (one.split(".")[-1] for one in strings if isinstance(one, str))


def strangers(file: Path, text: str) -> list[str]:
    """Private names of other rooms that a test uses."""
    tree = ast.parse(text)
    own = set(defined(tree)) | supported()
    asked = {name for name in used(tree) if is_private(name) and name not in own}
    return sorted(
        name for name in asked if homes().get(name, {room(file)}).isdisjoint({room(file)})
    )


@pytest.mark.parametrize("file", TESTS, ids=lambda p: str(p.relative_to(ROOT / "tests")))
def test_nothing_private_of_another_room_is_used(file: Path) -> None:
    assert strangers(file, file.read_text("utf-8")) == []


@pytest.mark.parametrize("text", [
    "from probe.storage.writer import _powers", "store._connection.close()",
    "monkeypatch.setattr('probe.storage.writer._powers', None)",
])  # fmt: skip
def test_a_test_that_does_is_seen(text: str) -> None:
    assert {"_powers", "_connection"} <= set(homes())
    assert len(strangers(ROOT / "tests" / "probe" / "gui" / "test_x.py", text)) == 1
    assert strangers(ROOT / "tests" / "probe" / "storage" / "test_x.py", text) == []


def signposts() -> list[Path]:
    return sorted(file for package in PACKAGES for file in (ROOT / package).rglob("__init__.py"))


@pytest.mark.parametrize("file", signposts(), ids=lambda file: str(file.parent.relative_to(ROOT)))
def test_each_folder_says_what_is_where_and_names_what_is_there(file: Path) -> None:
    said = ast.get_docstring(ast.parse(file.read_text("utf-8")))
    assert said
    here, inside = file.parent, {p.stem for p in file.parent.iterdir()}
    for name in re.findall(r"`([a-z_.]+)`", said.partition("\n\n")[0]):
        near = name in inside or (here.parent / name).exists() or (ROOT / name).exists()
        assert near or (here.parent.parent / f"{name.replace('.', '/')}.py").exists(), name
