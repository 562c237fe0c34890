"""Beside which versions of other libraries the environments install, step and train: a table.

python -m tests.neighbours [LIBRARY …] [--cache .neighbours] [--out docs/neighbours.txt] [--keep]

Each library gets a fresh virtual environment in the cache: first the library as pip alone chooses it, then
this software beside exactly that version. Then `with_LIBRARY.py` steps and trains there. Rows of libraries
that are not named stay as they were. Set PIP_CONSTRAINT to choose a build of torch.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
import venv
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
SHOWN = ("pettingzoo", "gymnasium", "numpy", "torch", "torchrl", "jax")  # beside which it works
LONGEST = 1200  # [s] of one installation or one program
HEADINGS = ("library", "version", "installed as", "beside", "steps", "trains")


class Neighbour(NamedTuple):
    """A library, what else its program needs, and the extra of this software that it is installed with."""

    package: str
    needs: tuple[str, ...] = ()
    extra: str = ""


NEIGHBOURS = {
    "AgileRL": Neighbour("agilerl", ("peft",)),  # which its algorithms import, whatever they are
    "BenchMARL": Neighbour("benchmarl", extra="[torchrl]"),
    "JaxMARL": Neighbour("jaxmarl", ("six",)),  # which gymnax 1.0.1 imports and does not ask for
    "RLlib": Neighbour("ray[rllib]", ("torch",)),
    "skrl": Neighbour("skrl", ("torch",)),
    "Stable-Baselines3": Neighbour("stable-baselines3"),
    "SuperSuit": Neighbour("supersuit", ("stable-baselines3",)),
    "Tianshou": Neighbour("tianshou"),
    "TorchRL": Neighbour("torchrl", extra="[torchrl]"),
    "XuanCe": Neighbour("xuance"),  # whose numpy < 2 has left no room for a program so far
}
PROGRAM = """
import sys
from importlib import import_module
sys.path.insert(0, sys.argv[1])
program = import_module(sys.argv[2])
for name in ("steps", "trains"):
    print(f"{name}: {getattr(program, name)()}", flush=True)
"""


class Failed(Exception):
    """A command did not do what it should; the message is what it said."""


def run(*command: str | Path, cwd: Path) -> str:
    """What a command prints; raises Failed with the reason that it gives at its end."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    kept |= {"OMP_NUM_THREADS": "1"}  # programs this small only wait for other threads
    how = {"cwd": cwd, "env": kept, "capture_output": True, "text": True, "timeout": LONGEST, "check": False}
    try:
        done = subprocess.run([*map(str, command)], **how)
    except subprocess.TimeoutExpired:
        raise Failed(f"not done after {LONGEST} s") from None
    (cwd / "log.txt").open("a").write(f"$ {command}\n{done.stdout}\n{done.stderr}\n")
    if done.returncode:
        raise Failed(reason(f"{done.stdout}\n{done.stderr}") + "\n" + done.stdout)
    return done.stdout


def reason(said: str) -> str:
    """The conflict that pip explains, its first line and ours, else the last line of an error."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    if "The conflict is caused by:" in lines:
        asked = lines[lines.index("The conflict is caused by:") + 1 :]
        return "; ".join([asked[0], *(line for line in asked if line.startswith("chemoswarm"))])
    told = [line for line in lines if "Error" in line] or lines or ["no reason given"]
    return told[-1]


def install(name: str, folder: Path) -> tuple[Path, dict[str, str]]:
    """The environment's Python, and the versions of all that is installed there."""
    package, needs, extra = NEIGHBOURS[name]
    python = folder / "bin" / "python"
    pip = (python, "-m", "pip", "install", "--progress-bar=off", "--no-compile")
    chosen = folder / "chosen"  # the version that pip chose
    if not chosen.exists():
        shutil.rmtree(folder, ignore_errors=True)
        venv.create(folder, with_pip=True)
        run(*pip, package, *needs, cwd=folder)
        chosen.write_text(versions_in(python, folder)[package.partition("[")[0]])
    run(*pip, f"{ROOT}{extra}", f"{package}=={chosen.read_text()}", *needs, cwd=folder)
    return python, versions_in(python, folder)


def versions_in(python: Path, folder: Path) -> dict[str, str]:
    """Version by the normalised name of each installed package."""
    told = json.loads(run(python, "-m", "pip", "list", "--format=json", cwd=folder))
    return {each["name"].lower().replace("_", "-"): each["version"] for each in told}


def row_of(name: str, folder: Path) -> dict[str, str]:
    """What became of one library: a row of the table."""
    extra = NEIGHBOURS[name].extra
    row = dict.fromkeys(HEADINGS, "—") | {"library": name, "installed as": f"`chemoswarm{extra}`"}
    try:
        python, found = install(name, folder)
        row["beside"] = ", ".join(f"{each} {found[each]}" for each in SHOWN if each in found)
        program = f"with_{name.lower().replace('-', '_')}"
        said = run(python, "-c", PROGRAM, Path(__file__).parent, program, cwd=folder)
    except Failed as failed:
        remark, _, said = str(failed).partition("\n")
        row["trains"] = f"no: {remark[:400]}"
    if (folder / "chosen").exists():
        row["version"] = (folder / "chosen").read_text()
    told = (line.split(": ", 1) for line in said.splitlines() if line.startswith(("steps: ", "trains: ")))
    return row | dict(told)


def table(rows: list[dict[str, str]], ours: str) -> str:
    """The rows as a Markdown table."""
    lines = [" | ".join(HEADINGS), "|".join("---" for _ in HEADINGS)]
    lines += [" | ".join(row[heading].replace("|", "/") for heading in HEADINGS) for row in rows]
    python = ".".join(map(str, sys.version_info[:3]))
    made = f"Made by `make neighbours` with chemoswarm {ours} and Python {python}."
    return "\n".join(f"| {line} |" for line in lines) + f"\n\n{made}\n"


def main() -> None:
    """Try the libraries that are named, else all, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.neighbours", description=__doc__.splitlines()[0])
    parser.add_argument("libraries", nargs="*", metavar="LIBRARY", help=", ".join(NEIGHBOURS))
    parser.add_argument("--cache", type=Path, default=ROOT / ".neighbours")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "neighbours.txt")
    parser.add_argument("--keep", action="store_true", help="keep the environments for the next time")
    given = parser.parse_args()
    if unknown := set(given.libraries) - set(NEIGHBOURS):
        parser.error(f"LIBRARY must be one of {', '.join(NEIGHBOURS)}, got {', '.join(sorted(unknown))}")
    results = given.cache.resolve() / "results"
    results.mkdir(parents=True, exist_ok=True)
    for name in given.libraries or NEIGHBOURS:
        began, folder = time.monotonic(), results.parent / name
        row = row_of(name, folder)
        (results / f"{name}.json").write_text(json.dumps(row, indent=1), encoding="utf-8")
        print(f"{name} {row['version']}: steps {row['steps']}; trains {row['trains']}", end=" ")
        print(f"({time.monotonic() - began:.0f} s)", flush=True)
        if not given.keep:
            shutil.rmtree(folder, ignore_errors=True)
    stored = [results / f"{name}.json" for name in NEIGHBOURS]
    rows = [json.loads(path.read_text(encoding="utf-8")) for path in stored if path.exists()]
    given.out.write_text(table(rows, version("chemoswarm")), encoding="utf-8")
    print(f"written to {given.out}")


if __name__ == "__main__":
    main()
