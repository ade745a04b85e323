"""What a report is made of, apart from how it is written down."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Text:
    """A paragraph; `code` within backquotes."""

    words: str


@dataclass(frozen=True)
class Table:
    """Rows of cells, the first column naming the row.

    Attributes:
        strong: rows to stand out.
    """

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    strong: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes:
        name: file name without suffix, unique in the report.
        png: its bytes.
        says: what is to be seen, for who cannot see it; also printed below.
    """

    name: str
    png: bytes
    says: str


@dataclass(frozen=True)
class Commands:
    """Commands to type."""

    lines: tuple[str, ...]


Block = Text | Table | Picture | Commands


@dataclass
class Section:
    """A heading and what is below it."""

    title: str
    blocks: list[Block] = field(default_factory=list)


@dataclass
class Document:
    """A whole report."""

    title: str
    sections: list[Section] = field(default_factory=list)

    @property
    def pictures(self) -> list[Picture]:
        """All pictures in order."""
        return [block for section in self.sections for block in section.blocks if isinstance(block, Picture)]
