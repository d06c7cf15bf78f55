"""What a source distribution holds: everything that is needed to read, test and rebuild it."""

import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest
from paths import ROOT
from programs import python

HELD = (
    "CHANGELOG.md", "CITATION.cff", "LICENSE", "README.md", "docs/index.md", "docs/generate.py",
    "rigs/ur5e.toml", "tests/palpate/test_sdist.py", "tests/support/paths.py",
    "palpate/__init__.py", "tests/data/runs/completed.run.xz", "mkdocs.yml",
    "sim_backend/fem/kernel/kernel.h",
)  # fmt: skip


def test_it_holds_changelog_docs_rigs_examples_and_tests(tmp_path: Path) -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False, timeout=60
    )
    if listed.returncode:
        pytest.skip("not a checkout of git")
    source = tmp_path / "source"
    names = listed.stdout.decode().rstrip("\0").split("\0")
    for name in names:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name)
    code = f"import setuptools.build_meta as b; b.build_sdist({str(tmp_path)!r})"
    python("-c", code, cwd=source, status=0)
    (made,) = tmp_path.glob("palpate-*.tar.gz")
    with tarfile.open(made) as packed:
        held = {name.partition("/")[2] for name in packed.getnames()}
    assert set(HELD) <= held
    examples = {name for name in names if name.startswith(("examples/", "rigs/", "tests/"))}
    assert examples <= held
    assert not [name for name in held if name.endswith((".pyc", ".so"))]
