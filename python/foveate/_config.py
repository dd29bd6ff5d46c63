"""``config=`` as the extension takes it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
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

    >>> given({"policy.gamma": 2.5, "policy": {"kind": "hedge"}}).settings
    ['policy.kind="hedge"', 'policy.gamma=2.5']
    >>> given("own.toml").path
    'own.toml'
    """
    if isinstance(config, Mapping):
        found = sorted(_settings(config, ""), key=_turn)
        return Given(settings=[f"{name}={value}" for name, value in found])
    if isinstance(config, str) and "\n" in config:
        return Given(text=config)
    if isinstance(config, (str, os.PathLike)):
        return Given(path=os.fsdecode(config))
    raise TypeError(
        f"config is a dict of settings, the path of a TOML file, or TOML text of more than one line; it is {type(config).__name__}"
    )


def _whole(name: str, table: Mapping[Any, Any]) -> bool:
    """Whether it is a complete table without defaults, which can be set only as a whole."""
    presence = table.get("presence") if name == "likelihood.distance" else None
    return (name == "likelihood.calibrate" and set(table) == {"nats", "least", "most"}) or (
        isinstance(presence, Mapping) and set(presence) == {"extra", "cap"}
    )


def _settings(settings: Mapping[Any, Any], above: str) -> Iterator[tuple[str, str]]:
    """Settings by their keys with dots, the values in TOML."""
    for key, value in settings.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping) and not _whole(name, value):
            yield from _settings(value, f"{name}.")
        else:
            yield name, _toml(value, name)


def _turn(setting: tuple[str, str]) -> tuple[bool, int]:
    """``kind`` comes first, outer before inner: it clears what belonged to another kind. All else stays in its order."""
    *above, last = setting[0].split(".")
    return last != "kind", len(above) if last == "kind" else 0


def _toml(value: object, name: str) -> str:
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars
        value = value.tolist()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_toml(v, name)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(v, name) for v in value) + "]"
    if isinstance(value, float):  # TOML has nan and inf, too
        return float.__repr__(value)
    if isinstance(value, (bool, int, str)):
        return json.dumps(value, ensure_ascii=False)
    raise ConfigError(f"config: {name} is a {type(value).__name__}; expected a number, a string, true or false, a list or a dict")
