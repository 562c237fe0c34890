"""Tasks that note in a file that they begin and end: which are at work, and which were begun again."""

import os
import sys


def noted(file, do, *arguments):
    """What a task gives, noting in a file its name, process and node."""
    name, ray = NAMES[do.__name__](*arguments), sys.modules.get("ray")
    node = ray.get_runtime_context().get_node_id() if ray and ray.is_initialized() else "here"
    _note(file, f"begin {name} {os.getpid()} {node}")
    found = do(*arguments)
    _note(file, f"end {name} {os.getpid()} {node}")
    return found


NAMES = {
    "lived": lambda test, block: f"lived:{block.number}",
    "advance": lambda run, before, epochs: f"{run.seed},{before.record['epoch'] if before else 0}",
    "collected": lambda run, block, policy, state, decisions: (
        f"{block.number},{state['episode'].max()},{state['decision'].max()}"
    ),
}


def _note(file, line):
    descriptor = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(descriptor, f"{line}\n".encode())
    os.close(descriptor)


def _lines(file, word):
    lines = [line.split() for line in file.read_text().splitlines()] if file.exists() else []
    return [(name, int(process), node) for kind, name, process, node in lines if kind == word]


def at_work(file, ended):
    """Tasks (name, process, node) that have begun and not ended, once so many have."""
    over = _lines(file, "end")
    return [task for task in _lines(file, "begin") if task not in over] if len(over) >= ended else []


def begun(file):
    """By name of a task the (process, node) of each time that it began."""
    found = {}
    for name, *where in _lines(file, "begin"):
        found.setdefault(name, []).append(tuple(where))
    return found
