"""Tables of the documentation: each cell bears its heading, by which narrow screens tell stacked cells apart.

`site.css` stacks the tables that are marked as wide; numbers and their spread stay in one line.
"""

import re
import xml.etree.ElementTree as etree
from html import unescape

from markdown import Extension, Markdown
from markdown.treeprocessors import Treeprocessor
from markdown.util import HTML_PLACEHOLDER_RE
from mkdocs.config.defaults import MkDocsConfig

ROOM = 360  # [px] within a narrow page
LETTER, PADDING = 7, 22  # [px] of a letter, and of a column
SHORT, LONG = 20, 60  # letters of a cell, at most, that is not broken, and from which it is a sentence


class HeadingsInCells(Treeprocessor):
    """Sets `data-label` of cells, `data-long` of those with sentences among many columns, and `data-wide` of
    tables for which a narrow page has no room.
    """

    def run(self, root: etree.Element) -> None:
        for table in root.iter("table"):
            rows = [list(row) for row in table.iter("tr")]
            headings, widths = [self.text_of(cell) for cell in rows[0]], [0] * len(rows[0])
            for row in rows:
                for place, cell in enumerate(row):
                    text = self.text_of(cell)
                    widths[place] = max(
                        widths[place], *map(len, [text] if len(text) <= SHORT else text.split()), 0
                    )
                    if len(text) > LONG and len(headings) > 3:
                        cell.set("data-long", "")
                    if cell.tag == "td":
                        cell.set("data-label", headings[place])
                        if cell.text and "right" in cell.get("style", ""):
                            space = "\N{NO-BREAK SPACE}" if len(cell.text) <= SHORT else " "
                            cell.text = re.sub(
                                r"(?<=\de)-(?=\d)", "\N{NON-BREAKING HYPHEN}", cell.text.replace(" ", space)
                            )
            if LETTER * sum(widths) + PADDING * len(widths) > ROOM:
                table.set("data-wide", "")

    def text_of(self, element: etree.Element) -> str:
        """What is read of an element, highlighted code included, which is kept apart until the end."""
        kept = self.md.htmlStash.rawHtmlBlocks
        text = HTML_PLACEHOLDER_RE.sub(lambda found: str(kept[int(found[1])]), "".join(element.itertext()))
        return unescape(re.sub(r"<[^>]*>", "", text)).strip()


class StackedTables(Extension):
    def extendMarkdown(self, md: Markdown) -> None:
        md.treeprocessors.register(HeadingsInCells(md), "headings in cells", 5)  # after what is inline


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    config.markdown_extensions.append(StackedTables())  # type: ignore[arg-type]
    return config
