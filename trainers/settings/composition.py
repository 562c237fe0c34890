"""Settings from YAML files and `key=value` words, composed by Hydra, checked by their types."""

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException, OverrideParseException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import TypeAdapter, ValidationError

from swarm._support import files
from swarm._support.checks import check_name
from swarm.physics.grids.netcdf import located
from swarm.physics.world import World
from swarm.physics.world.rules import PARTS
from swarm.policies.network import ZOO, load_policy
from trainers.settings.learning import ALGORITHMS
from trainers.settings.schema import Settings, unknown

RECORD, MAX_RECORD = "run.json", 2**18  # of what a run was made with, and its bytes
GROUPS = ("algorithm", "experiment", "recipe", "tuning")  # folders of files to choose from
QUOTES = "'\""
RULE_OF = {  # pydantic's kinds of errors, in the words of an error's rule
    "int_type": "a whole number",
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list",
    "dict_type": "keys and values",
    "dataclass_type": "keys and values",
    "greater_than": "above {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than_equal": "at most {le}",
}


class SettingsError(ValueError):
    """Settings that break a rule; the message names the key, the rule and the value."""


def config_folder() -> Path:
    """Where the YAML files are: inside an installed wheel, or beside the packages in a source tree."""
    here = Path(__file__).resolve().parents[1]
    for folder in (here.parent / "configs", here / "configs"):
        if (folder / "config.yaml").is_file():
            return folder
    raise FileNotFoundError(
        f"the folder configs must lie in {here} or beside it: the installation is damaged"
    )


def names_of(group: str) -> list[str]:
    """Names of the files in a group: algorithms, experiments, recipes."""
    return sorted(path.stem for path in (config_folder() / group).glob("*.yaml"))


def settings_from(words: Sequence[str] = ()) -> Settings:
    """Checked settings from `key=value` words over the files; raises SettingsError."""
    overrides = [_override(word) for word in words]
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(config_folder()), version_base="1.3"):
            chosen = compose("config", overrides)
        for name in (word.removeprefix("algorithm=") for word in words if word.startswith("algorithm=")):
            OmegaConf.update(chosen, "algorithm", name.strip(QUOTES), force_add=True)  # it may have no file
        for key in OmegaConf.missing_keys(chosen):
            raise SettingsError(f"{key} must have a value, got '???'")
        # An interpolation may name a key that neither a file nor a word gives.
        defaults = dataclasses.asdict(checked({"algorithm": chosen.algorithm}))
        for section in ("validation", "evaluation"):
            del defaults[section]["cells"]  # which follow from the world where they are left out
        values = OmegaConf.to_container(OmegaConf.merge(defaults, chosen), resolve=True)
    except SettingsError:
        raise
    except (HydraException, OmegaConfBaseException, TypeError, ValueError, AttributeError) as error:
        raise SettingsError(readable(error, words)) from None
    return checked(values)


def written(value: Any) -> str:
    """A value as it is written in a `key=value` word."""
    match value:
        case None | bool():
            return json.dumps(value)
        case dict():
            return "{" + ", ".join(f"{key}: {written(each)}" for key, each in value.items()) + "}"
        case list() | tuple():
            return "[" + ", ".join(map(written, value)) + "]"
        case str() if not re.fullmatch(r"[A-Za-z_][\w.]*", value):
            return json.dumps(value, ensure_ascii=False)
    return str(value)


def key_of(word: str) -> str:
    """The key of a `key=value` word; raises SettingsError where it is none."""
    if re.match(r"\W*hydra(\W|$)", word):
        raise SettingsError(f"of Hydra's own keys only hydra.run.dir=DIR may be given, got {word!r}")
    if not (match := re.match(r"([A-Za-z_][\w.]*)=", word)):
        raise SettingsError(f"a setting must be written key=value, got {word!r}")
    return match[1]


def _override(word: str) -> str:
    """A word as Hydra is to see it: it chooses a file, or sets a key whether or not a file has it, for
    whether there may be one is said by the types.
    """
    key = key_of(word)
    if key not in GROUPS:
        return f"++{word}"
    try:
        known = ALGORITHMS if key == "algorithm" else names_of(key)
        check_name(key, word.partition("=")[2].strip(QUOTES), known)
    except ValueError as error:
        raise SettingsError(str(error)) from None
    return word


def readable(error: Exception, words: Sequence[str]) -> str:
    """What Hydra, OmegaConf or Python says of the words, in one line."""
    if isinstance(error, OverrideParseException):
        word = error.override.removeprefix("++")
        return f"the value cannot be read, other signs than letters need quotes, got {word!r}"
    reason = str(error).splitlines()[0].replace("'++", "'")
    key = getattr(error, "full_key", None) or f"settings cannot be read from {' '.join(words)}"
    return f"{key}: {reason}"


def settings_from_stored(stored: Any, near: Path | None = None) -> Settings:
    """Checked settings from what a run has stored, which is data only; raises SettingsError.

    Files of data that are not where they were, seen from the current folder, are looked for in the folder
    that the run `near` was begun in, and `near` it: there, and in all folders above.
    """
    if isinstance(stored, dict) and isinstance(learning := stored.get("learning"), dict):
        # Version 0.1 could keep a running mean of the networks, which sets such a run apart.
        averaged = learning.get("average_rate", 1.0)
        stored = stored | {"learning": {name: learning[name] for name in learning.keys() - {"average_rate"}}}
        if averaged != 1.0:
            stored["recipe"] = f"{stored.get('recipe', 'paper')} average_rate={averaged}"
    if near is not None and isinstance(stored, dict):
        folders = [*_begun_in(near), near.resolve(), *near.resolve().parents]
        stored = {key: _with_data(key, section, folders) for key, section in stored.items()}
    return checked(stored, "stored settings: ")


def _begun_in(run: Path) -> list[Path]:
    """The folder that a run, or the one of several seeds, was begun in, where it says so."""
    for folder in (run, run.parent):
        try:
            record = json.loads(files.read_bytes(folder / RECORD, at_most=MAX_RECORD))
            return [Path(record["begun_in"])]
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            continue
    return []


def _with_data(key: str, section: Any, folders: Sequence[Path]) -> Any:
    """A section of settings whose fields and flows have their files of data."""
    if not isinstance(section, dict):
        return section
    found = dict(section)
    for name, part in section.items():
        if isinstance(part, dict) and isinstance(path := part.get("path"), str):
            places = [folder / each for each in (path, Path(path).name) for folder in folders]
            try:
                found[name] = part | {"path": located(path, part.get("sha256"), places)}
            except (OSError, ValueError) as error:
                raise SettingsError(f"stored settings: {key}.{name}: {error}") from None
    return found


def by_value(settings: Settings) -> dict[str, Any]:
    """Every key and its value, each said in one way: a part of the world whose parameters are its own
    defaults is its name.
    """
    told = settings.dotted()
    for key, known in ((f"world.{name}", known) for name, known in PARTS.items()):
        if isinstance(part := told.get(key), dict):
            with suppress(TypeError, ValueError, OSError):  # one that has no defaults
                told[key] = part["type"] if known.describe(known.make(part["type"])) == part else part
    return told


def differing(told: Sequence[Mapping[str, Any]]) -> list[str]:
    """The keys whose values are not the same in all of them."""
    keys = dict.fromkeys(key for each in told for key in each)
    return [key for key in keys if any(each.get(key, ...) != told[0].get(key, ...) for each in told)]


def settings_of(policy: str, experiment: str | None) -> Settings:
    """Settings of an experiment, or those a trained policy's card tells of, else of linear_n4."""
    from swarm.population.evaluation import STRATEGIES, named_policy

    if experiment is not None:
        return settings_from([f"experiment={experiment}"])
    if policy in STRATEGIES:
        return settings_from([])
    if not policy.startswith(ZOO) and not files.expanded(policy).exists():
        named_policy(policy, World())  # raises, and suggests what may be meant
    card = load_policy(policy).card
    known = card["settings"] if isinstance(card.get("settings"), dict) else {}
    stored = {name: known[name] for name in ("world", "evaluation") if name in known}
    stored["experiment"] = str(card.get("experiment", "own"))
    return settings_from_stored(stored, files.expanded(policy))


def checked(values: Any, prefix: str = "") -> Settings:
    """Settings of plain values; raises SettingsError that begins with `prefix`."""
    try:
        return TypeAdapter(Settings).validate_python(values)
    except ValidationError as error:
        raise SettingsError(prefix + line_of(error, values)) from None
    except RecursionError:
        raise SettingsError(f"{prefix}values must not hold one another so deeply") from None


def line_of(error: ValidationError, values: Any) -> str:
    """The first thing that is wrong in the values, in a line that names the key, the rule and the value."""
    first = error.errors(include_url=False)[0]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    if first["type"] in ("unexpected_keyword_argument", "invalid_key"):
        name = values.get("algorithm")
        known = isinstance(name, str) and name in ALGORITHMS
        return unknown(key, Settings(algorithm=name if known else "dqn").dotted())
    context, given = first.get("ctx", {}), first["input"]
    if first["type"] == "value_error":
        reason = str(context["error"])
        return reason if reason.startswith(key) else f"{key}.{reason}"
    if first["type"] == "literal_error":
        try:
            check_name(key, given, re.findall("'(.*?)'", context["expected"]))
        except (TypeError, ValueError) as named:
            return str(named)
    rule = RULE_OF.get(first["type"], first["msg"])
    rule = rule.format(**{name: str(value).removesuffix(".0") for name, value in context.items()})
    return f"{key or 'all of them'} must be {rule}, got {repr(given)[:200]}"
