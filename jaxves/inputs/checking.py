"""Strict checks of TOML tables. An error message is one line with the key, its value and what was expected.

The type of a key has a text that says what is expected (`Expect`). A check of several keys raises `refusal`. TOML has
no null, so None means that a required key is missing, and the text of its type says what is expected.
"""

import dataclasses
import difflib
import functools
import json
import operator
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Tag,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from ..base.bounds import Bounds


class SceneError(ValueError):
    """Wrong input. The message is one line."""


def refusal(expected: str, key: str = "", value: Any = None) -> PydanticCustomError:
    """Returns the error for a validator to raise: `key`, a path below the validated table, must not have this `value`.

    Without a key the validated value itself is refused.
    """
    context = {"expected": expected, "key": key, "value": _shown(value)}
    return PydanticCustomError("refused", "{expected}", context)


@dataclasses.dataclass(frozen=True)
class Expect:
    """The text for every error of a value. It must be the last constraint in `Annotated`."""

    text: str

    def __get_pydantic_core_schema__(self, source, handler):
        def check(value, inner):
            try:
                return inner(value)
            except ValidationError:
                raise refusal(self.text) from None

        return core_schema.no_info_wrap_validator_function(check, handler(source))


def number(bounds: Bounds) -> Any:
    """Returns a type for floats within `bounds`."""

    def check(value: float) -> float:
        if not bounds.hold(value):
            raise ValueError
        return value

    return Annotated[float, AfterValidator(check), Expect(bounds.expected)]


def one_of(*words: str) -> Any:
    """Returns a type for texts that are one of these words."""
    return Annotated[Literal[words], Expect("one of " + ", ".join(map(_toml, words)))]


class Table(BaseModel):
    """A table. An unknown key is an error."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, validate_default=True)
    told_apart_by: ClassVar[str | None] = None  # the key that selects one of several kinds of a table

    @model_validator(mode="before")
    @classmethod
    def _knows_its_keys(cls, values: Any) -> Any:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        for key in values if isinstance(values, dict) else ():
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                kind = cls.told_apart_by
                of = f' for {kind} = "{cls.model_fields[kind].default}"' if kind else ""
                expected = (
                    f"a known key: did you mean {near[0]}?" if near else f"one of the keys{of}: {', '.join(known)}"
                )
                raise refusal(expected, key, values[key])
        return values


def choice(*kinds: type[Table], default: str | None = None) -> Any:
    """Returns a type for tables that are one of `kinds`; the key `told_apart_by` selects which."""
    key = kinds[0].told_apart_by
    names = [kind.model_fields[key].default for kind in kinds]

    def check(value):
        if isinstance(value, Table):
            return value
        if not isinstance(value, dict):
            raise refusal("a table")
        if value.get(key, default) not in names:
            raise refusal("one of " + ", ".join(map(_toml, names)), key, value.get(key))
        return value

    def tag(value):
        name = value.get(key, default) if isinstance(value, dict) else getattr(value, key)
        return f"{key}={name}"

    tagged = [Annotated[kind, Tag(f"{key}={name}")] for kind, name in zip(kinds, names, strict=True)]
    return Annotated[functools.reduce(operator.or_, tagged), Discriminator(tag), BeforeValidator(check)]


def checked(model: type[Table], values: Mapping[str, Any], origin: str, **context: Any) -> Any:
    """Checks `values` and returns them as a `model`.

    Raises:
        SceneError: a value is wrong. The message is about the first one and begins with `origin`.
    """
    try:
        return model.model_validate(dict(values), context=context)
    except ValidationError as error:
        complaint = error.errors(include_url=False)[0]
    said = complaint.get("ctx", {})
    # "key=name" is the tag of a choice, which is not a level of the file.
    path = [part for part in complaint["loc"] if not (isinstance(part, str) and "=" in part)]
    path += [said["key"]] if said.get("key") else []
    value = said["value"] if said.get("key") else _shown(complaint["input"])
    raise SceneError(f"{origin}: {dotted(path)}{value}, expected {said.get('expected', 'a table')}")


def dotted(path: Sequence[str | int]) -> str:
    """Returns a path as text: ("vesicle", 0, "angle") becomes vesicle[0].angle."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def _toml(value: Any) -> str:
    return repr(value) if isinstance(value, float) else json.dumps(value, default=str, ensure_ascii=False)


def _shown(value: Any) -> str:
    if value is None:
        return " is missing"
    if isinstance(value, dict):
        return ""
    text = _toml(value)
    return " = " + (text if len(text) <= 80 else text[:77] + "...")
