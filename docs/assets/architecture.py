"""The picture of the house, drawn from the code: `python docs/assets/architecture.py` writes it to images/.

Rooms and what they say of themselves come from the packages, the floors from the import contracts, the dots
from the imports.
"""

from __future__ import annotations

import ast
import textwrap
import tomllib
from pathlib import Path
from xml.sax.saxutils import escape

import grimp

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
WIDTH, LEFT, ROW, CELL = 1000, 16, 62, 20
STYLE = (
    "text{font-family:system-ui,sans-serif;fill:#222}.room{font-size:14px;font-weight:600}.says{font-size:12px}"
    ".holds{font-size:11px;fill:#555;font-family:ui-monospace,monospace}.number{font-size:11px;text-anchor:middle}"
)


def floors(package: str) -> list[str]:
    """Rooms of a package from the top floor down, as its import contract states them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = next(each["layers"] for each in contracts["contracts"] if each.get("containers") == [package])
    return [f"{package}.{room}" for layer in layers for room in layer.split(" | ")]


def says(folder: Path) -> str:
    """The first sentence of a room's docstring."""
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.split("\n\n")[0].replace("\n", " ").replace("`", "")


def holds(folder: Path) -> str:
    """The names of what lies in a room; sub-rooms end in a slash."""
    rooms = [f"{path.parent.name}/" for path in sorted(folder.glob("*/__init__.py"))]
    return ", ".join(rooms + [path.stem for path in sorted(folder.glob("[!_]*.py"))])


def row_of(number: int, room: str, right: float) -> list[str]:
    """A room: its box, its name, and what it says and holds."""
    top, folder = 40 + ROW * number, ROOT / room.replace(".", "/")
    colour = "#e8eef7" if room.startswith("swarm") else "#f7efe3"
    box = f'x="{LEFT}" y="{top}" width="{right - LEFT - 10}" height="{ROW - 8}"'
    words = escape(textwrap.shorten(says(folder), 64, placeholder=" …"))
    parts = [
        f'<rect {box} rx="6" fill="{colour}"/>',
        f'<text x="{LEFT + 10}" y="{top + 17}" class="room">{number + 1} · {room.replace(".", "/")}</text>',
        f'<text x="{LEFT + 215}" y="{top + 17}" class="says">{words}</text>',
    ]
    for i, line in enumerate(textwrap.wrap(holds(folder), 88)[:2]):
        parts.append(f'<text x="{LEFT + 10}" y="{top + 33 + 13 * i}" class="holds">{escape(line)}</text>')
    return parts


def picture() -> str:
    """The SVG: a row for each room, upper floors first; a dot where it imports from that column's room."""
    graph = grimp.build_graph("swarm", "trainers", cache_dir=None)
    rooms = floors("trainers") + floors("swarm")
    for room in rooms:
        graph.squash_module(room)
    right, parts = WIDTH - LEFT - CELL * len(rooms), []
    for row, room in enumerate(rooms):
        parts += row_of(row, room, right)
        seen = graph.find_modules_directly_imported_by(room)
        for column, other in enumerate(rooms):
            x, y = right + CELL * column + CELL / 2, 40 + ROW * row + (ROW - 8) / 2
            if row == 0:
                parts.append(f'<text x="{x}" y="28" class="number">{column + 1}</text>')
            if column == row:
                parts.append(f'<rect x="{x - 4}" y="{y - 4}" width="8" height="8" fill="#c8c8c8"/>')
            elif other in seen:
                parts.append(f'<circle cx="{x}" cy="{y}" r="5" fill="#31688e"/>')
    height, body = 40 + ROW * len(rooms) + 6, "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">\n'
        f"<title>Rooms of the house and what each imports from</title>\n<style>{STYLE}</style>\n"
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
