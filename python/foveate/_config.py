"""``config=`` as the extension takes it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .errors import ConfigError


@dataclass
class Given:
    """TOML text or a file in the profile's place, or settings that are changed in it."""

    text: str | None = None
    path: str | None = None
    settings: list[str] = field(default_factory=list)


def given(config: object) -> Given:
    """A dict changes settings; a path is a file; a string of more than one line is TOML.

    >>> given({"particles": 400, "policy": {"kind": "hedge"}}).settings
    ['particles=400', 'policy.kind="hedge"']
    >>> given("own.toml").path
    'own.toml'
    """
    if isinstance(config, Mapping):
        return Given(settings=_settings(config, ""))
    if isinstance(config, str) and "\n" in config:
        return Given(text=config)
    if isinstance(config, (str, os.PathLike)):
        return Given(path=os.fsdecode(config))
    raise TypeError(
        f"config is a dict of settings, the path of a TOML file, or TOML text of more than one line; it is {type(config).__name__}"
    )


def _settings(settings: Mapping[Any, Any], above: str) -> list[str]:
    """Settings as ``key=value`` in TOML; ``kind`` comes first, for it clears what belonged to another kind."""
    found = []
    for key in sorted(settings, key=lambda key: key != "kind"):
        name, value = f"{above}{key}", settings[key]
        if isinstance(value, Mapping):
            found += _settings(value, f"{name}.")
        else:
            found.append(f"{name}={_toml(value, name)}")
    return found


def _toml(value: object, name: str) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_toml(v, name)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(v, name) for v in value) + "]"
    if hasattr(value, "item"):  # NumPy's scalars
        value = value.item()
    if isinstance(value, (bool, int, float, str)):
        return json.dumps(value, ensure_ascii=False)
    raise ConfigError(f"config: {name} is a {type(value).__name__}; expected a number, a string, true or false, a list or a dict")
