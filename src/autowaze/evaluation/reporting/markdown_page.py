"""A report as Markdown, pictures in a folder beside it."""

from __future__ import annotations

from autowaze.evaluation.reporting.document import Block, Commands, Document, Picture, Table

PICTURES = "images"


def markdown_of(document: Document) -> str:
    """The text; pictures are expected as `images/NAME.png` beside the file."""
    parts = [f"# {document.title}"]
    for section in document.sections:
        parts.append(f"## {section.title}")
        parts += [_block(block) for block in section.blocks]
    return "\n\n".join(parts) + "\n"


def _block(block: Block) -> str:
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Picture):
        return f"![{block.says}]({PICTURES}/{block.name}.png)"
    if isinstance(block, Commands):
        return "\n".join(["```", *block.lines, "```"])
    return block.words


def _table(table: Table) -> str:
    rows = [
        tuple(f"**{cell}**" if number in table.strong and cell else cell for cell in row)
        for number, row in enumerate(table.rows)
    ]
    lines = [table.headings, ("---",) * len(table.headings), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)
