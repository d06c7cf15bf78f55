"""What the base install weighs by plain pip, on each Python that this machine has."""

import os
import shutil
import subprocess
import tempfile
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

from figures.keep import ROOT

VERSIONS = ("3.11", "3.12", "3.13", "3.14")
HEAD = (
    "Python", "environment before (MB)", "added by `pip install .` (MB)", "of that compiled (MB)",
    "SciPy and NumPy (MB)", "in all on the disk (MB)", "in all, bytes (MB)",
)  # fmt: skip
BLOCK_B = 512  # of `st_blocks`, by POSIX
PIP = ("-m", "pip", "--disable-pip-version-check", "--quiet")


def install() -> dict[str, Any]:
    """Sizes as the disk has them, in blocks: `du` of a fresh environment before and after.

    The packages are those of the newest Python, with what pip compiled of them.
    """
    rows = [row for version in VERSIONS if (row := _weighed(version)) is not None]
    if not rows:
        raise RuntimeError(f"none of Python {', '.join(VERSIONS)} is here")
    return {
        "largest_added_mb": max(row["added"] for row in rows),
        "smallest_added_mb": min(row["added"] for row in rows),
        "head": HEAD,
        "table": [
            [row["python"], *(f"{row[key]:.0f}" for key in
             ("before", "added", "compiled", "numerics", "whole", "bytes"))]
            for row in rows
        ],
        "packages_head": ("package", f"on Python {rows[-1]['python']} (MB)"),
        "packages_table": [[name, f"{mb:.1f}"] for name, mb in rows[-1]["packages"]],
    }  # fmt: skip


def _weighed(version: str) -> dict[str, Any] | None:
    python = _python(version)
    if python is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        clone, venv = Path(folder, "clone"), Path(folder, "venv")
        subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
        subprocess.run([python, "-m", "venv", venv], check=True)
        before = _mb(venv)
        subprocess.run([venv / "bin" / "python", *PIP, "install", clone], check=True)
        (packages,) = venv.glob("lib/python3*/site-packages")
        numerics = [p for name in ("numpy", "scipy") for p in packages.glob(f"{name}*")]
        whole = _mb(venv)
        return {
            "python": version,
            "before": before,
            "added": whole - before,
            "compiled": whole - _mb(venv, "--exclude=*.pyc"),
            "numerics": sum(map(_mb, numerics)),
            "whole": whole,
            "bytes": _mb(venv, "--apparent-size"),
            "packages": _packages(packages),
        }


def _packages(folder: Path) -> list[tuple[str, float]]:
    """Name and size of each that the metadata in ``folder`` names, the largest first."""
    found = []
    for one in distributions(path=[str(folder)]):
        files = [Path(str(one.locate_file(file))) for file in one.files or ()]
        blocks = sum(file.stat().st_blocks for file in files if file.is_file())
        found.append((one.metadata["Name"], blocks * BLOCK_B / 2**20))
    return sorted(found, key=lambda pair: -pair[1])


def _python(version: str) -> str | None:
    """The first interpreter of a version that starts: the system's, or one of pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    named = shutil.which(f"python{version}")
    for path in (named, *map(str, sorted(pyenv.glob(f"{version}.*/bin/python")))):
        if (
            path
            and subprocess.run([path, "-c", "import venv"], capture_output=True).returncode == 0
        ):
            return path
    return None


def _mb(path: Path, *options: str) -> float:
    said = subprocess.run(["du", "-sk", *options, path], capture_output=True, text=True, check=True)
    return int(said.stdout.split()[0]) / 1024
