"""Settings from YAML files and `key=value` words, composed by Hydra over the typed defaults and checked."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException, OverrideParseException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from swarm._support.checks import check_box, check_name
from trainers.settings.schema import Settings

GROUPS = ("experiment", "recipe", "tuning")  # folders of files to choose from


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
    """Names of the files of a group."""
    return sorted(path.stem for path in (config_folder() / group).glob("*.yaml"))


def experiments() -> list[str]:
    """Names of the experiments."""
    return names_of("experiment")


def recipes() -> list[str]:
    """Names of the recipes."""
    return names_of("recipe")


def register() -> None:
    """Make the typed defaults known to Hydra as `settings`."""
    ConfigStore.instance().store(name="settings", node=Settings)


def settings_from(words: Sequence[str] = ()) -> Settings:
    """Checked settings from `key=value` words over the files; raises SettingsError."""
    for word in words:
        if re.match(r"\W*hydra[./]", word):
            raise SettingsError(f"of Hydra's own keys only hydra.run.dir=DIR may be given, got {word!r}")
        _check_word(word)
    register()
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(config_folder()), version_base="1.3"):
            return as_settings(compose("config", list(words)))
    except (HydraException, OmegaConfBaseException) as error:
        raise SettingsError(readable(error)) from None
    except SettingsError:
        raise
    except (TypeError, ValueError, AttributeError) as error:  # Hydra's own, over values it does not expect
        raise SettingsError(f"settings cannot be read from {' '.join(words)}: {error}") from None


def _check_word(word: str) -> None:
    """Raises SettingsError where Hydra would stumble or take a number for a flag."""
    if not (match := re.fullmatch(r"([A-Za-z_][\w.]*)=(.*)", word, re.DOTALL)):
        raise SettingsError(f"a setting must be written key=value, got {word!r}")
    key, value = match.groups()
    if key in GROUPS:
        try:
            check_name(key, value.strip("'\""), names_of(key))
        except ValueError as error:
            raise SettingsError(str(error)) from None
    if key in _flags() and value.lower() not in ("true", "false") and not value.startswith("${"):
        raise SettingsError(f"{key} must be true or false, got {value!r}")


def settings_from_stored(stored: dict[str, Any]) -> Settings:
    """Checked settings from what a run has stored, which is data only; raises SettingsError."""
    schema = OmegaConf.structured(Settings)
    learning = stored.get("learning")
    if isinstance(learning, dict) and learning.get("average_rate") == 1:  # runs of version 0.1 hold it
        stored = stored | {"learning": {name: learning[name] for name in learning if name != "average_rate"}}
    _check_stored(stored, OmegaConf.to_container(schema), "")
    try:
        return as_settings(OmegaConf.merge(schema, stored))
    except OmegaConfBaseException as error:
        raise SettingsError(f"stored settings: {readable(error)}") from None


def _check_stored(value: Any, default: Any, key: str) -> None:
    """Raises SettingsError where OmegaConf would see more than plain values, or would not name the key."""
    if isinstance(default, dict):
        if not isinstance(value, dict):
            raise SettingsError(
                f"stored settings: {key or 'all of them'} must be keys and values, got {value!r}"
            )
        for name, inner in value.items():
            if name not in default:
                near = _nearest(str(name), list(default))
                raise SettingsError(f"stored settings: {key or 'settings'} must not hold {name!r}{near}")
            _check_stored(inner, default[name], f"{key}.{name}".lstrip("."))
    elif isinstance(default, list) and not isinstance(value, list):
        raise SettingsError(f"stored settings: {key} must be a list, got {value!r}")
    elif isinstance(default, bool) and not isinstance(value, bool):
        raise SettingsError(f"stored settings: {key} must be true or false, got {value!r}")
    elif key == "world.start_box" and value is not None:
        try:
            check_box(f"stored settings: {key}", value)
        except ValueError as error:
            raise SettingsError(str(error)) from None
    elif "${" in repr(value):
        raise SettingsError(f"stored settings: {key} must be a plain value, got {value!r}")


def as_settings(config: Any) -> Settings:
    """Typed and checked settings from a composed configuration; raises SettingsError."""
    try:
        settings = OmegaConf.to_object(config)
    except OmegaConfBaseException as error:
        raise SettingsError(readable(error)) from None
    except (TypeError, ValueError, AttributeError) as error:
        raise SettingsError(readable(error)) from None
    assert isinstance(settings, Settings)
    return settings


def readable(error: Exception) -> str:
    """Hydra's message in one line, with the nearest name for what it does not know."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    message = lines[0] if lines else type(error).__name__
    message = message.removeprefix("Could not create instance of `Settings`: ")
    if isinstance(error, OverrideParseException):
        return f"the value cannot be read, other signs than letters need quotes, got {error.override!r}"
    if unknown := re.search(r"Could not override '([\w.@/]+)'", message):
        key = unknown.group(1)
        return f"settings have no key {key!r}{_nearest(key, _keys())}"
    if (merging := re.match(r"Error merging override (\S+?)=", message)) and error.__cause__ is not None:
        return f"{merging.group(1)}: {str(error.__cause__).splitlines()[0]}"
    key = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("full_key:")), None)
    return f"{key}: {message}" if key else message


def _flags() -> list[str]:
    """Keys whose value is true or false."""
    settings = OmegaConf.structured(Settings)
    return [key for key in _keys() if isinstance(OmegaConf.select(settings, key), bool)]


def _nearest(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
    return f"; did you mean {near[0]!r}?" if near else ""


def _keys(node: Any = None, prefix: str = "") -> list[str]:
    """All keys of the settings, dotted."""
    node = OmegaConf.structured(Settings) if node is None else node
    found = []
    for key in node:
        value = node._get_node(key)
        found.append(prefix + str(key))
        if OmegaConf.is_dict(value) and not value._is_none():
            found += _keys(value, f"{prefix}{key}.")
    return found
