"""What became of the mutants: counts by module, and every survivor with its reason to live.

    python tests/mutants.py [--write PAGE] [FOLDER]

Reads what `mutmut run` left in FOLDER (`mutants`) and prints a table in Markdown; `--write` puts it at the
end of a page. Reasons stand in tests/mutants.toml, by function and change. Ends with exit code 1 where a
survivor has no reason there, a reason has no survivor, or a mutant was not run.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import re
import sys
import tomllib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

REASONS = Path(__file__).with_suffix(".toml")
BEGIN = "<!-- what follows is written by tests/mutants.py -->"
# By the exit code of pytest, or of mutmut's runner, as `mutmut.stats` reads it.
KILLED, SURVIVED, TIMEOUT = {1, 3}, {0}, {-24, 24, 36, 152, 255}
KINDS = {
    "equivalent": "the same values for every input",
    "speed": "the same values, in another time or memory",
    "boundary": "differs only where two numbers are equal to the last bit, or by a rounding error",
    "calibration": "another number of an estimate; what it is there for is tested",
    "elsewhere": "noticed where JAX or a second device is there, which the run was without",
    "wording": "only the literal text of an error; the thing and the value in it are tested",
}


class Mutant(NamedTuple):
    """A changed function: what it was and what it becomes, in the lines that differ."""

    module: str
    function: str
    was: str
    becomes: str
    wording: bool  # whether nothing differs but literal text of an error
    code: int | None


def functions_of(path: Path) -> dict[str, str]:
    """Source of every function of a mutated module, original or mutant, by mutmut's name for it."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    return {
        node.name: "\n".join(lines[node.lineno - 1 : node.end_lineno])
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and "__mutmut_" in node.name
    }


def difference(original: str, mutant: str) -> tuple[str, str]:
    """The lines that differ, without the name."""
    first, second = (re.sub(r"__mutmut_\w+", "", text, count=1).splitlines() for text in (original, mutant))
    changes = list(difflib.ndiff(first, second))
    was, becomes = (
        " ⏎ ".join(line[2:].strip() for line in changes if line.startswith(sign)) for sign in ("- ", "+ ")
    )
    return was, becomes


def without_wording(source: str) -> str:
    """The function with every text in its errors left out, letters and the name of the function too."""
    tree = ast.parse(
        re.sub(r"__mutmut_\w+", "", re.sub(r"(?m)^    ", "", source) if source[0] == " " else source)
    )
    for error in (node for node in ast.walk(tree) if isinstance(node, ast.Raise)):
        for node in ast.walk(error):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                node.value = ""
    return ast.dump(tree)


def mutants_of(folder: Path) -> list[Mutant]:
    """All mutants and what became of them."""
    found = []
    for meta in sorted(folder.glob("**/*.py.meta")):
        codes = json.loads(meta.read_text(encoding="utf-8"))["exit_code_by_key"]
        sources = functions_of(meta.with_suffix(""))
        for key, code in codes.items():
            module, _, name = key.rpartition(".")
            base = name.rpartition("__mutmut_")[0]
            original, mutant = sources[f"{base}__mutmut_orig"], sources[name]
            was, becomes = difference(original, mutant)
            wording = code in SURVIVED and without_wording(original) == without_wording(mutant)
            function = (
                base.removeprefix("x_") if base.startswith("x_") else base[1:].strip("ǁ").replace("ǁ", ".")
            )
            found.append(Mutant(module, function, was, becomes, wording, code))
    return found


class Reason(NamedTuple):
    """Why a survivor may live."""

    kind: str  # one of `KINDS`
    why: str


Key = tuple[str, str, str]  # module and function, what it was, what it becomes


def reasons() -> dict[Key, Reason]:
    """What tests/mutants.toml says."""
    known = {}
    for entry in tomllib.loads(REASONS.read_text(encoding="utf-8"))["reason"] if REASONS.exists() else []:
        assert entry["kind"] in KINDS, f"kind must be one of {', '.join(KINDS)}, got {entry['kind']!r}"
        for was, becomes in entry["changes"]:
            known[entry["function"], was, becomes] = Reason(entry["kind"], entry["why"])
    return known


def counts(mutants: list[Mutant]) -> list[str]:
    """Counts by module, in Markdown."""
    lines = ["| module | mutants | killed | timed out | survived | left |", "|---|--:|--:|--:|--:|--:|"]
    for module in [*sorted({mutant.module for mutant in mutants}), "all"]:
        mine = [mutant for mutant in mutants if module in (mutant.module, "all")]
        cells = [sum(mutant.code in codes for mutant in mine) for codes in (KILLED, TIMEOUT, SURVIVED)]
        cells = [len(mine), *cells, len(mine) - sum(cells)]
        lines.append(f"| `{module}` | " + " | ".join(str(cell) for cell in cells) + " |")
    return lines


def report(mutants: list[Mutant], survivors: dict[Key, Reason | None]) -> list[str]:
    """The tables, in Markdown."""
    unknown = Reason("unexplained", "")
    lines = [*counts(mutants), "", "| kind | survivors | |", "|---|--:|---|"]
    kinds = Counter((reason or unknown).kind for reason in survivors.values())
    lines += [f"| {kind} | {kinds[kind]} | {meaning} |" for kind, meaning in KINDS.items()]
    lines += ["", "| function | kind | survivors | why |", "|---|---|--:|---|"]
    rows = Counter((key[0], reason or unknown) for key, reason in survivors.items())
    lines += [
        f"| `{name}` | {kind} | {count} | {why} |" for (name, (kind, why)), count in sorted(rows.items())
    ]
    return lines


WORDING = Reason("wording", "what the error names is tested, not its words")


def main(folder: Path, page: Path | None) -> int:
    """Print the report, or write it to a page; returns the exit code."""
    mutants, known = mutants_of(folder), reasons()
    survivors: dict[Key, Reason | None] = {}
    for mutant in mutants:
        if mutant.code in SURVIVED:
            key = (f"{mutant.module}.{mutant.function}", mutant.was, mutant.becomes)
            survivors[key] = WORDING if mutant.wording else known.get(key)
    lines = report(mutants, survivors)
    if page is None:
        print("\n".join(lines))
    else:
        head = page.read_text(encoding="utf-8").partition(BEGIN)[0]
        page.write_text("\n".join([head + BEGIN, "", *lines]) + "\n", encoding="utf-8")
    unexplained = [key for key, reason in survivors.items() if reason is None]
    needless = sorted(known.keys() - survivors.keys())
    for complaint, keys in (("unexplained", unexplained), ("no such survivor", needless)):
        for name, was, becomes in keys:
            print(f"{complaint}: {name}\n  - {was}\n  + {becomes}", file=sys.stderr)
    left = sum(mutant.code not in KILLED | SURVIVED | TIMEOUT for mutant in mutants)
    if left:
        print(f"{left} mutants were not run, or no test reaches them", file=sys.stderr)
    return int(bool(unexplained or needless or left))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("mutants"))
    parser.add_argument("--write", type=Path, metavar="PAGE")
    options = parser.parse_args()
    sys.exit(main(options.folder, options.write))
