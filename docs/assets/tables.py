"""Tables of the documentation: each cell bears its heading, by which narrow screens tell stacked cells apart.

`site.css` stacks the tables that are marked as wide; numbers and their spread stay in one line.
"""

import xml.etree.ElementTree as etree

from markdown import Extension, Markdown
from markdown.treeprocessors import Treeprocessor
from mkdocs.config.defaults import MkDocsConfig

ROOM = 360  # [px] within a narrow page
LETTER, PADDING = 7, 22  # [px] of a letter, and of a column
SHORT = 20  # letters of a cell, at most, that is not broken


def text_of(element: etree.Element) -> str:
    return "".join(element.itertext()).strip()


class HeadingsInCells(Treeprocessor):
    """Sets `data-label` of cells, and `data-wide` of tables for which a narrow page has no room."""

    def run(self, root: etree.Element) -> None:
        for table in root.iter("table"):
            rows = [list(row) for row in table.iter("tr")]
            headings, widths = [text_of(cell) for cell in rows[0]], [0] * len(rows[0])
            for row in rows:
                for place, cell in enumerate(row):
                    words = [text_of(cell)] if len(text_of(cell)) <= SHORT else text_of(cell).split()
                    widths[place] = max(widths[place], *map(len, words), 0)
                    if cell.tag == "td":
                        cell.set("data-label", headings[place])
                        if cell.text and len(cell.text) <= SHORT and "right" in cell.get("style", ""):
                            cell.text = cell.text.replace(" ", "\N{NO-BREAK SPACE}")
            if LETTER * sum(widths) + PADDING * len(widths) > ROOM:
                table.set("data-wide", "")


class StackedTables(Extension):
    def extendMarkdown(self, md: Markdown) -> None:
        md.treeprocessors.register(HeadingsInCells(md), "headings in cells", 5)  # after what is inline


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    config.markdown_extensions.append(StackedTables())  # type: ignore[arg-type]
    return config
