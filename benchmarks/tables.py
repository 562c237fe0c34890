"""Results of benchmarks as tables in Markdown."""

from __future__ import annotations

from typing import Any


def as_table(rows: list[dict[str, Any]]) -> str:
    """Rows as a table in Markdown."""
    heads = [name.replace("_", " ") for name in rows[0]]
    lines = [heads, ["--"] + ["--:"] * (len(heads) - 1)]
    for row in rows:
        lines.append(
            [
                f"{cell:.3g}" if isinstance(cell, float) else str("" if cell is None else cell)
                for cell in row.values()
            ]
        )
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def as_text(result: list[dict[str, Any]] | dict[str, list[dict[str, Any]]]) -> str:
    """A benchmark's table, or its tables under their titles, for the page of results."""
    if isinstance(result, list):
        return as_table(result)
    return "\n".join(f"**{title}**\n\n{as_table(rows)}" for title, rows in result.items())
