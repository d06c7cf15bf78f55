"""The drivers in docs/how-to/add-a-driver.md, as they are written there, keep the contract."""

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from programs import python

DOC = Path(__file__).resolve().parents[1] / "docs" / "how-to" / "add-a-driver.md"
FENCE = re.compile(r"^```(?:python|toml)\n# (\S+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with the files of the document, as if the package were installed."""
    files = dict(FENCE.findall(DOC.read_text("utf-8")))
    assert set(files) == {
        "acme_gauge.py", "acme_table.py", "pyproject.toml", "rig.toml", "acme_bench.py"
    }  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).write_text(text, "utf-8")
    groups = tomllib.loads(files["pyproject.toml"])["project"]["entry-points"]
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in points.items())
        for group, points in groups.items()
    ]
    (info / "entry_points.txt").write_text("\n".join(lines))
    return tmp_path


def contract(package: Path, driver: str, bench: str) -> subprocess.CompletedProcess[str]:
    return python(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--palpate-driver={driver}",
        f"--palpate-bench=acme_bench:{bench}", cwd=package,
        env=os.environ | {"PYTHONPATH": str(package)},
    )  # fmt: skip


@pytest.mark.parametrize("name", ["acme_gauge.py", "acme_table.py"])
def test_it_takes_less_than_sixty_lines(package: Path, name: str) -> None:
    code = [line for line in (package / name).read_text("utf-8").splitlines() if line]
    assert len(code) < 60


@pytest.mark.parametrize("driver, bench, outcome", [
    ("acme", "bench", "7 passed, 6 skipped"), ("acme-table", "table", "6 passed, 7 skipped"),
])  # fmt: skip
def test_it_keeps_the_contract(package: Path, driver: str, bench: str, outcome: str) -> None:
    """Those that are skipped are of the other kind."""
    ran = contract(package, driver, bench)
    assert ran.returncode == 0, ran.stdout
    assert outcome in ran.stdout, ran.stdout


@pytest.mark.parametrize("file, right, wrong, driver, bench", [
    ("acme_table.py", "for axis, place in places_mm.items())",
     "for axis, place in ({'x': 0, 'y': 0, 'z': 0} | places_mm).items())",
     "acme-table", "table"),
    ("acme_gauge.py", "[Sample(middle_s,", "[Sample(middle_s - self.began_s,", "acme", "bench"),
])  # fmt: skip
def test_a_mistake_that_its_emulated_device_shares_is_noticed(
    package: Path, file: str, right: str, wrong: str, driver: str, bench: str
) -> None:
    """Axes that nobody named go to 0; times are those of a device that counts since it was made."""
    source = (package / file).read_text("utf-8")
    assert right in source
    source = source.replace(right, wrong)
    source = source.replace("self.lost = 0\n", "self.lost, self.began_s = 0, self.due_s\n", 1)
    (package / file).write_text(source, "utf-8")
    assert contract(package, driver, bench).returncode == 1


def test_its_rig_file_names_it(package: Path) -> None:
    table = tomllib.loads((package / "rig.toml").read_text("utf-8"))
    assert table["sensor"][0]["driver"] == "acme"
    assert table["stage"]["driver"] == "acme-table"
