"""YAML as people expect it, read strictly; whatever is wrong comes out as a ConfigError with file and line."""

import difflib
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import ComposerError

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import read_text


def near(name: object, names: Iterable[str]) -> str:
    """The hint "Did you mean 'x'?" for the closest of the known names, or the list of them when none is close."""
    known = sorted({str(n) for n in names})
    close = difflib.get_close_matches(str(name), known, n=1, cutoff=0.6)
    if close:
        return f" Did you mean '{close[0]}'?"
    return f" Known: {', '.join(known)}." if known else ""


MOST_YAML = 10_000_000  # bytes; a vehicle has some 10,000
MOST_DIGITS = 19  # of a whole number: as many as nanoseconds since 1970 have
MOST_NUMBER = 1e15  # no quantity of a vehicle or a sea is as large, and squares of it are still numbers
LONGEST = 60  # characters of a text that a message repeats
MOST = 1_000_000  # values in a file, those counted again that an alias repeats


class _Loader(yaml.SafeLoader):
    """YAML 1.2: 1e-3 is a number, 012 is 12, `no`, `1:30` and `2021-06-01` are strings; a key may be given once."""

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None and _size(node, {}) > MOST:
            text = f"found more than {MOST:,} values, those counted again that aliases (*name) repeat; expected fewer"
            raise ComposerError(None, None, text, node.start_mark)
        return node


def _size(node: yaml.Node, known: dict[int, float]) -> float:
    """Values in a node, inf where it contains itself. A few lines of aliases of aliases can fill any memory."""
    if id(node) not in known:
        known[id(node)] = math.inf  # as long as its parts are counted
        parts = node.value if isinstance(node, yaml.CollectionNode) else ()
        flat = (one for part in parts for one in (part if isinstance(part, tuple) else (part,)))
        known[id(node)] = 1.0 + sum(_size(one, known) for one in flat)
    return known[id(node)]


_Loader.yaml_implicit_resolvers = {
    first: [(tag, rule) for tag, rule in rules if not tag.endswith((":bool", ":int", ":float", ":timestamp"))]
    for first, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), "tTfF")
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"""^(?:[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?
        |[-+]?[0-9]+[eE][-+]?[0-9]+|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$""",
        re.X,
    ),
    "-+0123456789.",
)

_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$"), "-+0123456789"
)


def _whole(loader: _Loader, node: yaml.ScalarNode) -> int:
    text = str(loader.construct_scalar(node))
    digits, base = text.lstrip("+-"), {"0o": 8, "0x": 16}.get(text[:2], 10)
    value = int(text if base == 10 else text[2:], base) if len(digits) <= LONGEST else None
    if value is None or abs(value) >= 10**MOST_DIGITS:
        problem = f"found a number of {len(digits)} digits, expected at most {MOST_DIGITS}"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    return value


def _real(loader: _Loader, node: yaml.ScalarNode) -> float:
    value = loader.construct_yaml_float(node)
    if math.isfinite(value) and abs(value) > MOST_NUMBER or math.isinf(value) and "inf" not in node.value.lower():
        problem = f"found {node.value[:LONGEST]}, expected a number below {MOST_NUMBER:g}"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    return value


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict:
    seen: dict[object, int] = {}
    for key_node, _ in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            continue
        key, line = loader.construct_object(key_node, deep=True), key_node.start_mark.line + 1
        if isinstance(key, (list, dict)):
            raise yaml.constructor.ConstructorError(None, None, "a key must be a word", key_node.start_mark)
        if key in seen:
            text = f"key '{key}' is given twice, first in line {seen[key]}; keep one"
            raise yaml.constructor.ConstructorError(None, None, text, key_node.start_mark)
        seen[key] = line
    loader.flatten_mapping(node)
    return {loader.construct_object(k, deep=True): loader.construct_object(v, deep=True) for k, v in node.value}


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
_Loader.add_constructor("tag:yaml.org,2002:int", _whole)
_Loader.add_constructor("tag:yaml.org,2002:float", _real)


class Dumper(yaml.SafeDumper):
    """Text that a reader of YAML 1.1 or of 1.2 would take for something else is quoted: '08', '1:30', 'no'."""


Dumper.yaml_implicit_resolvers = {
    first: [*yaml.SafeDumper.yaml_implicit_resolvers.get(first, ()), *_Loader.yaml_implicit_resolvers.get(first, ())]
    for first in {*yaml.SafeDumper.yaml_implicit_resolvers, *_Loader.yaml_implicit_resolvers}
}


def dump_yaml(data: Any, **style: Any) -> str:
    """YAML text, in the order of the data, that `parse_yaml` reads back as the same; `style` as of `yaml.dump`."""
    return yaml.dump(data, Dumper=Dumper, **({"sort_keys": False, "width": 120} | style))


def read_yaml(path: str | Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigError: No such file (with near names), unreadable, not YAML (with the line), a key given twice, or
            something else than a mapping.
    """
    path = Path(path)
    try:
        text = read_text(path, MOST_YAML)
    except FileNotFoundError:
        raise ConfigError(_missing_file(path)) from None
    except IsADirectoryError:
        raise ConfigError(f"{path}: is a folder, expected a YAML file") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not text, expected a YAML file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    return parse_yaml(text, path.name)


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """The mapping in YAML text; `where` names it in messages. Raises ConfigError as `read_yaml` does."""
    try:
        data = yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise ConfigError(f"{where}: {line}{_yaml_problem(error)}") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{where}: not YAML ({str(error).splitlines()[0]})") from None
    except RecursionError:
        raise ConfigError(f"{where}: nested too deeply to be meant") from None
    except (ValueError, IndexError, KeyError, AttributeError):  # of PyYAML, where a tag is not true
        raise ConfigError(f"{where}: a value is not what its tag (such as !!int) says; leave the tag out") from None
    if data is None:
        raise ConfigError(f"{where}: is empty, expected keys and values")
    if not isinstance(data, dict):
        found = "text" if isinstance(data, str) else kind_in_words(data)  # another program's file may hold a secret
        raise ConfigError(f"{where}: found {found}, expected keys and values such as 'name: my_vehicle'")
    return data


_OWN = ("given twice", "must be a word", "expected fewer", "expected at most", "expected a number below")


def _yaml_problem(error: yaml.MarkedYAMLError) -> str:
    problem = error.problem or "not YAML"
    if any(own in problem for own in _OWN):
        return problem
    hint = " (indent with spaces, not tabs)" if r"'\t'" in problem else ""
    context = f" {error.context}" if error.context else ""
    return f"not YAML: {problem}{context}{hint}"


def _missing_file(path: Path) -> str:
    folder = path.parent
    if not folder.is_dir():
        return f"{path}: no such file; there is no folder {folder} either"
    names = [p.name for p in folder.iterdir() if p.suffix in (".yaml", ".yml")]
    return f"{path}: no such file." + (near(path.name, names) if names else f" There is no YAML file in {folder}.")


def kind_in_words(value: Any) -> str:
    """What a value is, in words: a mapping, a list of 3 values, nothing, or the value itself."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {counted(len(value))}"
    if isinstance(value, str) and len(value) > LONGEST:
        return repr(f"{value[:LONGEST]}..")
    return "nothing" if value is None else repr(value)


def counted(number: int) -> str:
    """1 value, 3 values."""
    return "1 value" if number == 1 else f"{number} values"
