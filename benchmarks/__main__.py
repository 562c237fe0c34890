"""`python -m benchmarks [NAME ...]`: measure, print tables, write JSON files with where they come from."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from pathlib import Path
from typing import Any

from swarm import files, provenance

NAMES = ("pettingzoo_path", "training_path")


def as_table(rows: list[dict[str, Any]]) -> str:
    """Rows as a table in Markdown, for the page of results."""
    heads = [name.replace("_", " ") for name in rows[0]]
    lines = [heads, ["--"] + ["--:"] * (len(heads) - 1)]
    for row in rows:
        lines.append([f"{cell:.3g}" if isinstance(cell, float) else str(cell or "") for cell in row.values()])
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def main() -> None:
    """Run the named benchmarks, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks"), help="folder for the JSON files")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or NAMES:
        print(f"\n{name}")
        rows = importlib.import_module(f"benchmarks.{name}").run()
        record = {
            "benchmark": name,
            "rows": rows,
            "versions": provenance.versions(),
            "commit": provenance.commit(),
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
        }
        files.write_text(options.out / f"{name}.json", json.dumps(record, indent=1) + "\n")
        files.write_text(options.out / f"{name}.txt", as_table(rows))
    print(f"\nwritten to {options.out}")


if __name__ == "__main__":
    main()
