"""The README and the pages of docs/, as what they show: fenced blocks by language, links, names between backticks."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from helpers.robots import ROOT

_FENCE = re.compile(r"^```([a-z{][^\n]*)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = re.compile(r"`([^`\n]+)`")


@dataclass(frozen=True)
class Page:
    """A page of the manual."""

    path: Path

    @property
    def name(self) -> str:
        """Its path in the repository."""
        return self.path.relative_to(ROOT).as_posix()

    @cached_property
    def text(self) -> str:
        """All of it."""
        return self.path.read_text(encoding="utf-8")

    @cached_property
    def blocks(self) -> list[tuple[str, str]]:
        """Its fenced blocks: language and content."""
        return [(language, body) for language, body in _FENCE.findall(self.text)]

    def of(self, language: str) -> list[str]:
        """The blocks of one language."""
        return [body for own, body in self.blocks if own == language]

    @property
    def commands(self) -> list[str]:
        """What it asks a person to type, but for what sets the project up, which CI runs."""
        blocks = (block.replace("\\\n", "") for block in self.of("sh"))  # a line may go on below
        lines = [line for block in blocks for line in block.strip().splitlines()]
        return [line for line in lines if line.startswith(("lab ", ".venv/bin/lab "))]

    @cached_property
    def prose(self) -> str:
        """It without its blocks."""
        return _FENCE.sub("", self.text)

    @property
    def links(self) -> list[str]:
        """Where its links and pictures lead."""
        return _LINK.findall(self.prose)

    @property
    def names(self) -> list[str]:
        """What stands between backticks."""
        return _CODE.findall(self.prose)


README = Page(ROOT / "README.md")
PAGES = [README, Page(ROOT / "CONTRIBUTING.md"), Page(ROOT / "CHANGELOG.md")]
PAGES += [Page(path) for path in sorted((ROOT / "docs").rglob("*.md"))]
