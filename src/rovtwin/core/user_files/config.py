"""Files that people write: reading YAML strictly, and parsing it into pydantic models with messages that help.

A file is parsed in two steps, `parse(Scenario, read_yaml(path), path.name)`. Whatever is wrong with it comes out as one
ConfigError with a line per mistake: file, place, what was found, what was expected, the fix.
"""

import difflib
import math
import re
import types
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import counted, kind_in_words, near, parse_yaml, read_yaml


class Strict(BaseModel):
    """Base of everything read from files: immutable, and a key that nobody knows is a mistake."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _radians(value: float) -> float:
    if abs(value) > 2.0 * math.pi:
        raise ValueError(f"found {value:g} rad, which looks like degrees: write {math.radians(value):.4g}")
    return value


# Strict numbers: neither "30" nor true is one. YAML integers are.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Share = Annotated[Number, Field(ge=0, le=1)]
Radians = Annotated[Number, AfterValidator(_radians)]
Degrees = Annotated[Number, Field(ge=-360, le=360)]
Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Degrees3 = Annotated[list[Degrees], Field(min_length=3, max_length=3)]

Parsed = TypeVar("Parsed", bound=BaseModel)


def parse(model_class: type[Parsed], data: Any, where: str) -> Parsed:
    """An instance of a pydantic model, or a ConfigError with a line for every mistake.

    Args:
        model_class: What the data should be.
        data: As `read_yaml` returned it.
        where: Name of the file (or of whatever else it came from) for the messages.
    """
    if not isinstance(data, dict):
        raise ConfigError(f"{where}: found {kind_in_words(data)}, expected a mapping of keys to values")
    try:
        return model_class.model_validate(data)
    except ValidationError as error:
        raise ConfigError("\n".join(f"{where}: {line}" for line in messages(model_class, data, error))) from None


def messages(model_class: type[BaseModel], data: Any, error: ValidationError) -> list[str]:
    """One line per mistake: `place: what was found, what was expected. The fix`."""
    by_place: dict[str, list[tuple[str, bool]]] = {}
    for item in error.errors(include_url=False):
        path = _path(data, item["loc"], item["type"])
        text = _say(item, _fields_at(model_class, item["loc"][:-1]), _field_at(model_class, item["loc"]))
        by_place.setdefault(path, []).append((text, _is_of_other_kind(item)))
    lines = []
    for path, found in by_place.items():
        deeper = any(other.startswith((f"{path}.", f"{path}[")) for other in by_place)
        # In a union the branch that got further is the one that was meant: drop "expected a number" of the others.
        meant = [text for text, other_kind in found if not other_kind]
        if not meant and deeper:
            continue
        sentence = _joined(meant or [text for text, _ in found])
        lines.append(f"{path}: {sentence}" if path else sentence)
    return lines


def _is_of_other_kind(item: Any) -> bool:
    """Whether a list or mapping was found where something else was expected, rather than a bad one of its kind."""
    expected_other = item["type"].endswith("_type") or item["type"] == "literal_error"
    return expected_other and isinstance(item["input"], (dict, list))


def _joined(texts: list[str]) -> str:
    """What the branches of a union say about one place, as one sentence."""
    texts = list(dict.fromkeys(texts))
    found, expected, _ = texts[0].partition(", expected ")
    if expected and all(s.startswith(found + expected) for s in texts):
        return found + expected + " or ".join(s.removeprefix(found + expected) for s in texts)
    return ", or: ".join(texts)


def _path(data: Any, loc: tuple[int | str, ...], kind: str) -> str:
    """`parts[1].mass` of a pydantic location; names of union branches, which the data does not have, fall out."""
    path, here = "", data
    for position, step in enumerate(loc):
        last = position == len(loc) - 1
        if isinstance(here, dict) and (step in here or (last and kind == "missing")):
            path += f".{step}" if path else str(step)
            here = here.get(step)
        elif isinstance(here, (list, tuple)) and isinstance(step, int) and step < len(here):
            path += f"[{step}]"
            here = here[step]
    return path


def _say(item: Any, known: dict[str, Any], field: Any) -> str:
    kind, found, context = item["type"], item["input"], item.get("ctx", {})
    if kind == "extra_forbidden":
        key = item["loc"][-1]
        if key in known:  # of another branch of the union
            return "no such key beside this type"
        return "no such key." + near(key, known)
    if kind == "missing" and isinstance(item["loc"][-1], int):  # of a list of a fixed length
        return f"found {counted(len(found))}, expected more"
    if kind == "missing":
        meaning = f" ({field.description})" if field is not None and field.description else ""
        return f"missing{meaning}"
    if kind in ("value_error", "assertion_error"):
        return str(context.get("error", item["msg"])).removeprefix("Value error, ")
    if kind == "union_tag_not_found":
        given = f" with {', '.join(map(str, found))}" if isinstance(found, dict) and found else ""
        key = context["discriminator"]
        return f"found {kind_in_words(found)}{given}, expected the key {key} in it, which says its kind"
    if kind in ("literal_error", "enum", "union_tag_invalid"):
        expected = str(context.get("expected") or context.get("expected_tags"))
        tag = context.get("tag", found)
        return f"found {_show(tag)}, expected {expected}{_close(tag, expected)}"
    if kind == "invalid_key":
        return f"found the key {_show(found)}, expected a word"
    if kind in ("too_short", "too_long"):
        expected = context.get("min_length", context.get("max_length"))
        return f"found {counted(context['actual_length'])}, expected {expected}"
    return f"found {_show(found)}, expected {_expected(kind, context, item['msg'])}{_unit_hint(kind, found)}"


_EXPECTED = {
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping of keys to values",
    "model_type": "a mapping of keys to values",
    "model_attributes_type": "a mapping of keys to values",
    "string_type": "text",
    "none_required": "nothing",
}
_BOUNDS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("of at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("of at most", "le"),
}


def _expected(kind: str, context: dict[str, Any], message: str) -> str:
    if kind in _BOUNDS:
        words, key = _BOUNDS[kind]
        return f"a number {words} {context[key]:g}"
    if kind.startswith("float"):
        return "a number"
    if kind.startswith("int"):
        return "a whole number"
    return _EXPECTED.get(kind) or message[:1].lower() + message[1:].removeprefix("nput should be ")


def _unit_hint(kind: str, found: Any) -> str:
    if kind.startswith(("float", "int")) and isinstance(found, str) and re.match(r"^\s*[-+]?[0-9.]", found):
        return "; units are fixed (SI) and are not written"
    return ""


def _close(found: Any, expected: str) -> str:
    close = difflib.get_close_matches(str(found), re.findall(r"'([^']+)'", expected), n=1)
    return f". Did you mean '{close[0]}'?" if close else ""


def _show(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return kind_in_words(value)
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _candidates(annotation: Any) -> list[Any]:
    """The concrete types behind an annotation: aliases, Annotated and unions are opened."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _candidates(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return [c for branch in get_args(annotation) for c in _candidates(branch)]
    return [annotation]


def _inside(annotation: Any, step: int | str) -> tuple[list[Any], Any]:
    """Types found one step further, and the pydantic field stepped through, if it was one."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        field = annotation.model_fields.get(str(step))
        if field is None:  # a name of the user's where the class has such; else that of a union's branch: stays here
            of_user = get_args(annotation.__annotations__.get("__pydantic_extra__"))
            return _candidates(of_user[1]) if of_user else [annotation], None
        return _candidates(field.annotation), field
    arguments = get_args(annotation)
    if get_origin(annotation) in (list, tuple, dict) and arguments:
        return _candidates(arguments[-1] if get_origin(annotation) is dict else arguments[0]), None
    return [annotation], None


def _walk(model_class: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[list[Any], Any]:
    here, field = [model_class], None
    for step in loc:
        # A step that names one of several classes picks that branch of the union.
        branch = [t for t in here if isinstance(t, type) and t.__name__ == step]
        if branch:
            here, field = branch, None
            continue
        stepped = [_inside(t, step) for t in here]
        here = [t for found, _ in stepped for t in found]
        field = next((f for _, f in stepped if f is not None), None)
    return here, field


def _fields_at(model_class: type[BaseModel], loc: tuple[int | str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for annotation in _walk(model_class, loc)[0]:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            found |= annotation.model_fields
    return found


def _field_at(model_class: type[BaseModel], loc: tuple[int | str, ...]) -> Any:
    return _walk(model_class, loc)[1]


__all__ = [
    "Degrees",
    "Degrees3",
    "NonNegative",
    "Number",
    "Positive",
    "Radians",
    "Share",
    "Strict",
    "Vector3",
    "messages",
    "near",
    "parse",
    "parse_yaml",
    "read_yaml",
]
