"""A report as one HTML page that needs nothing besides itself."""

from __future__ import annotations

import base64
import re
from html import escape
from importlib.resources import files
from string import Template

from autowaze.evaluation.reporting.document import Block, Commands, Document, Picture, Section, Table


def html_of(document: Document) -> str:
    """The page; pictures are inside it."""
    page = Template((files("autowaze.evaluation.reporting") / "page.html").read_text(encoding="utf-8"))
    entries = "".join(f'<li><a href="#{_anchor(s)}">{escape(s.title)}</a></li>' for s in document.sections)
    body = "\n".join(_section(section) for section in document.sections)
    return page.substitute(title=escape(document.title), entries=entries, body=body)


def _section(section: Section) -> str:
    blocks = "\n".join(_block(block) for block in section.blocks)
    return f'<section id="{_anchor(section)}">\n<h2>{escape(section.title)}</h2>\n{blocks}\n</section>'


def _block(block: Block) -> str:
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Picture):
        data, says = base64.b64encode(block.png).decode(), escape(block.says)
        return f'<figure><img src="data:image/png;base64,{data}" alt="{says}"><figcaption>{says}</figcaption></figure>'
    if isinstance(block, Commands):
        return f'<pre tabindex="0"><code>{escape(chr(10).join(block.lines))}</code></pre>'
    return f"<p>{_words(block.words)}</p>"


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{_words(cell)}</th>' for cell in table.headings)
    rows = []
    for number, (first, *rest) in enumerate(table.rows):
        kind = ' class="strong"' if number in table.strong else ""
        cells = "".join(f"<td>{_words(cell)}</td>" for cell in rest)
        rows.append(f'<tr{kind}><th scope="row">{_words(first)}</th>{cells}</tr>')
    body, name = "\n".join(rows), escape(table.headings[0].replace("`", ""))
    return (
        f'<div class="wide" tabindex="0" role="group" aria-label="table by {name}">'
        f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>"
    )


def _words(text: str) -> str:
    """Escaped, with code where backquotes say so."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def _anchor(section: Section) -> str:
    return re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-")
