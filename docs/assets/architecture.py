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

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
WIDTH, LEFT, ROW, CELL = 1000, 16, 62, 20


def floors(package: str) -> list[str]:
    """Rooms of a package from the top floor down, as its import contract states them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = next(each["layers"] for each in contracts["contracts"] if each.get("containers") == [package])
    return [room for layer in layers for room in layer.split(" | ")]


def modules_of(package: str, room: str) -> list[Path]:
    """The files of a room, or the one file that it is."""
    folder = ROOT / package / room
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


def says(package: str, room: str) -> str:
    """The first sentence of a room's docstring."""
    folder = ROOT / package / room
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.split("\n\n")[0].replace("\n", " ").replace("`", "")


def holds(package: str, room: str) -> str:
    """The names of what lies in a room; sub-rooms end in a slash."""
    folder = ROOT / package / room
    if not folder.is_dir():
        return ""
    rooms = [f"{path.parent.name}/" for path in sorted(folder.glob("*/__init__.py"))]
    return ", ".join(rooms + [path.stem for path in sorted(folder.glob("[!_]*.py"))])


def seen_from(package: str, room: str) -> set[str]:
    """Rooms (`package.room`) that a room imports from."""
    found = set()
    for path in modules_of(package, room):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            found |= {
                ".".join(name.split(".")[:2]) for name in names if name.split(".")[0] in ("swarm", "trainers")
            }
    return found - {f"{package}.{room}"}


def picture() -> str:
    """The SVG: a row for each room, upper floors first; a dot where it imports from that column's room."""
    rooms = [(package, room) for package in ("trainers", "swarm") for room in floors(package)]
    right = WIDTH - LEFT - CELL * len(rooms)
    parts = []
    for row, (package, room) in enumerate(rooms):
        top = 40 + ROW * row
        colour = "#e8eef7" if package == "swarm" else "#f7efe3"
        box = f'x="{LEFT}" y="{top}" width="{right - LEFT - 10}" height="{ROW - 8}"'
        parts.append(f'<rect {box} rx="6" fill="{colour}"/>')
        parts.append(f'<text x="{LEFT + 10}" y="{top + 17}" class="room">{row + 1} · {package}/{room}</text>')
        words = escape(textwrap.shorten(says(package, room), 64, placeholder=" …"))
        parts.append(f'<text x="{LEFT + 215}" y="{top + 17}" class="says">{words}</text>')
        lines = textwrap.wrap(holds(package, room), 88)[:2]
        parts += [
            f'<text x="{LEFT + 10}" y="{top + 33 + 13 * i}" class="holds">{escape(line)}</text>'
            for i, line in enumerate(lines)
        ]
        seen = seen_from(package, room)
        for column, (other, name) in enumerate(rooms):
            x, y = right + CELL * column + CELL / 2, top + (ROW - 8) / 2
            if row == 0:
                parts.append(f'<text x="{x}" y="28" class="number">{column + 1}</text>')
            if f"{other}.{name}" in seen:
                parts.append(f'<circle cx="{x}" cy="{y}" r="5" fill="#31688e"/>')
            elif column == row:
                parts.append(f'<rect x="{x - 4}" y="{y - 4}" width="8" height="8" fill="#c8c8c8"/>')
    height = 40 + ROW * len(rooms) + 6
    style = (
        "text{font-family:system-ui,sans-serif;fill:#222}.room{font-size:14px;font-weight:600}.says{font-size:12px}"
        ".holds{font-size:11px;fill:#555;font-family:ui-monospace,monospace}.number{font-size:11px;text-anchor:middle}"
    )
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">\n'
        f"<title>Rooms of the house and what each imports from</title>\n<style>{style}</style>\n"
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
