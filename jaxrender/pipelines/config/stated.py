"""The rule that every stated key has an effect or is refused, for the root of any config.

A ``Case`` is a situation of a config, the keys that have no effect in it, and why.  A root lists
its cases.  A stated key without effect is an error at that key.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar, NamedTuple

from pydantic import BaseModel, model_validator

from jaxrender.pipelines.config.document import Location, StatedInVain
from jaxrender.pipelines.config.values import Section
from jaxrender.pipelines.config.wording import stated_in_vain


class Case(NamedTuple):
    """A situation, and the keys that have no effect in it.

    ``name`` is the subject of the message, and may depend on the config.  ``keys`` maps a dotted
    key or a section to the predicate of the message.  ``agrees`` are values that ask for what is
    done anyway; a switch that is off asks for nothing.  ``instead`` is another remedy than to
    remove the key.
    """

    name: str | Callable[[Any], str]
    applies: Callable[[Any], bool]
    keys: Mapping[str, str]
    agrees: Mapping[str, tuple[Any, ...]] = {}
    instead: str = ""


class Root(Section):
    """The root of a config."""

    cases: ClassVar[tuple[Case, ...]] = ()

    def in_vain(self, asked: Callable[[str], bool] = lambda key: True) -> dict[str, str]:
        """Give reason and remedy for each key without effect, stated or not, of those asked for."""
        found: dict[str, str] = {}
        for case in self.cases:
            # Whether a case applies takes longer to say than whether anything of it is asked for.
            keys = {key: why for key, why in case.keys.items() if asked(key)}
            if not keys or not case.applies(self):
                continue
            name = case.name if isinstance(case.name, str) else case.name(self)
            instead = f", or {case.instead}" if case.instead else ""
            for key, why in keys.items():
                value = at(self, key)
                agrees = value is False or value in case.agrees.get(key, ())
                if not agrees and not any(f"{key}.".startswith(f"{one}.") for one in found):
                    found[key] = f"{name} {why}; remove it{instead}"
        return found

    def refuse_in_vain(self) -> None:
        """Raise ``StatedInVain``, a ``ValueError``, for stated keys that have no effect."""
        found = self.in_vain(partial(is_stated, self))
        if found:
            lines = (stated_in_vain(key, _written(self, key), why) for key, why in found.items())
            reasons: dict[Location, str] = {tuple(k.split(".")): why for k, why in found.items()}
            raise StatedInVain("\n".join(lines), reasons)

    def written_out(self) -> dict[str, Any]:
        """Return all keys that have an effect, defaults included, as plain data."""
        plain = self.model_dump(mode="json", exclude_none=True)
        for key in self.in_vain():
            *parts, name = key.split(".")
            section: Any = plain
            for part in parts:
                section = section.get(part) if isinstance(section, dict) else None
            if isinstance(section, dict):
                section.pop(name, None)
        return plain

    @model_validator(mode="after")
    def _nothing_is_ignored(self) -> Root:
        self.refuse_in_vain()
        return self


def is_stated(config: Section, key: str) -> bool:
    """Tell whether a user has given a dotted key, or any key of a section."""
    value: Any = config
    for part in key.split("."):
        if not isinstance(value, BaseModel) or part not in value.model_fields_set:
            return False
        value = getattr(value, part)
    if "." not in key and isinstance(value, BaseModel):
        return bool(value.model_fields_set)
    return value is not None


def at(config: Section, key: str) -> Any:
    """Look up a dotted key; None where its section is absent."""
    value: Any = config
    for part in key.split("."):
        value = getattr(value, part, None)
    return value


def _written(config: Section, key: str) -> Any:
    """Return the value of a key as a file would state it."""
    value = at(config, key)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True)
    return list(value) if isinstance(value, tuple) else value
