"""One breakage: a unique piece of the source is replaced, and somebody must notice."""

from dataclasses import dataclass
from pathlib import Path


class Gone(RuntimeError):
    """The piece of source that a mutant breaks is not there, or is there twice."""


@dataclass(frozen=True)
class Mutant:
    """``old`` becomes ``new`` in ``file``; ``tests`` (node ids) or ``runs`` must then fail.

    A run is ``clock seed kind[+kind]`` of the fault campaign.
    """

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()

    def mutated(self, root: Path) -> str:
        """The broken file's text. Raises `Gone`."""
        text = (root / self.file).read_text(encoding="utf-8")
        if (count := text.count(self.old)) != 1:
            raise Gone(f"{self.name}: {self.old!r} is {count} times in {self.file}")
        return text.replace(self.old, self.new)
