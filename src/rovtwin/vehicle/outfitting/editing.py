"""Vehicle files edited as text: parts and spare sensors change, every other line and comment stays as it was.

A YAML writer would lose comments and layout, so that the places where a list begins and ends are taken from the parsed
nodes, and lines are put in or taken out there.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import near, parse_yaml

MADE = "# Made by `rovtwin "
_TEXT = "tag:yaml.org,2002:str"


def with_parts(text: str, parts: list[dict[str, Any]], where: str) -> str:
    """The text of a vehicle file with parts added at the end of its list.

    Args:
        text: Of the file.
        parts: What to add, each as it should be read.
        where: Name of the file, for messages.

    Raises:
        ConfigError: The text is no YAML, or its parts cannot be edited as text.
    """
    listed, data = _listed(text, "parts", where), parse_yaml(text, where)
    expected = data | {"parts": [*(data.get("parts") or []), *parse_yaml(written({"parts": parts}), where)["parts"]]}
    return _checked(_longer(text, listed, parts), expected, where)


def _longer(text: str, listed: yaml.SequenceNode | None, parts: list[dict[str, Any]]) -> str:
    if listed is None:
        root = yaml.compose(text, yaml.SafeLoader)
        if isinstance(root, yaml.MappingNode) and root.flow_style and root.value:
            end = root.value[-1][1].end_mark.index
            return f"{text[:end]}, parts: {_flow(parts)}{text[end:]}"
        lines = "".join(f"  - {_flow(part)}\n" for part in parts)
        return f"{text.rstrip()}\nparts:\n{lines}"
    if listed.flow_style:
        end = listed.value[-1].end_mark.index if listed.value else listed.end_mark.index - 1  # of its bracket
        return text[:end] + (", " if listed.value else "") + ", ".join(map(_flow, parts)) + text[end:]
    lines = text.splitlines(keepends=True)
    at = _last_line(listed.value[-1]) + 1
    lines[at - 1] = lines[at - 1].rstrip("\n") + "\n"  # the last line of a file may lack its end
    dash = " " * _dash(text, listed.value[0]).column
    return "".join([*lines[:at], *(f"{dash}- {_flow(part)}\n" for part in parts), *lines[at:]])


def without_part(text: str, name: str, where: str) -> str:
    """The text of a vehicle file without a part, named as in its own list `parts`.

    Raises:
        ConfigError: It has no such part, with the names that it has, or its parts cannot be edited as text.
    """
    listed = _listed(text, "parts", where)
    items = [] if listed is None else listed.value
    names = [_name(item) for item in items]
    if listed is None or name not in names:
        present = f"its parts are {', '.join(names)}" if names else "it has no parts"
        raise ConfigError(f"{where}: no part '{name}': {present}.{near(name, names) if names else ''}")
    k, data = names.index(name), parse_yaml(text, where)
    expected = data | {"parts": [*data["parts"][:k], *data["parts"][k + 1 :]]}
    return _checked(_shorter(text, listed, k), expected, where)


def with_spares(text: str, names: Sequence[str | None], where: str) -> str:
    """The text of a vehicle file with the names in its list `spare_sensors` in place of those there, without the None.

    Raises:
        ConfigError: The list cannot be edited as text.
    """
    data = parse_yaml(text, where)
    for k in reversed(range(len(names))):
        listed, name = _listed(text, "spare_sensors", where), names[k]
        assert listed is not None
        item = listed.value[k]
        if name is None:
            text = _shorter(text, listed, k)
        elif name != item.value:
            text = text[: item.start_mark.index] + _flow(name) + text[item.end_mark.index :]
    return _checked(text, data | {"spare_sensors": [name for name in names if name is not None]}, where)


def _shorter(text: str, listed: yaml.SequenceNode, k: int) -> str:
    items = listed.value
    if listed.flow_style:
        if k + 1 < len(items):
            return text[: items[k].start_mark.index] + text[items[k + 1].start_mark.index :]
        if k == 0:  # a comma may follow the only part
            return text[: items[0].start_mark.index] + text[listed.end_mark.index - 1 :]
        return text[: items[k - 1].end_mark.index] + text[items[k].end_mark.index :]
    first, last = _dash(text, items[k]).line, _last_line(items[k])
    lines = text.splitlines(keepends=True)
    rest = "".join(lines[:first] + lines[last + 1 :])
    if len(items) > 1:
        return rest
    at = _before_dashes(text, items[0])  # `parts:` with nothing behind it would be nothing at all
    return f"{rest[:at]} []{rest[at:]}"


def _checked(text: str, expected: dict[str, Any], where: str) -> str:
    """An edited text that says what it should; YAML has more layouts than are known here."""
    try:
        if parse_yaml(text, where) == expected:
            return text
    except ConfigError:
        pass
    raise ConfigError(
        f"{where}: found parts or spare_sensors in a layout that cannot be edited line by line: edit the file by hand"
    )


def made_by(command: str) -> str:
    """First line of a file that a command writes."""
    return f"{MADE}{command.removeprefix('rovtwin ')}`.\n"


def is_made(text: str) -> bool:
    """Whether a command wrote the head of a file, and so may write it again."""
    return text.startswith(MADE)


def with_head(text: str, command: str, name: str, description: str, where: str) -> str:
    """The text of a vehicle file with another command in its first line, another name and another description.

    Raises:
        ConfigError: The text is no YAML, or these cannot be edited as text.
    """
    head, data = {"name": name, "description": description}, parse_yaml(text, where)
    root = yaml.compose(text, yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    found = {key.value: value for key, value in root.value if key.value in head}
    for key, node in sorted(found.items(), key=lambda one: -one[1].start_mark.index):
        end = "\n" if isinstance(node, yaml.ScalarNode) and node.style in ("|", ">") else ""
        text = text[: node.start_mark.index] + _flow(head[key]) + end + text[node.end_mark.index :]
    rest = text.partition("\n")[2] if is_made(text) else text
    missing = "".join(f"{key}: {_flow(value)}\n" for key, value in head.items() if key not in found)
    return _checked(made_by(command) + missing + rest, data | head, where)


def with_references(text: str, renamed: Callable[[str, str], str]) -> str:
    """The text of a vehicle file with each file that it names, at any depth, named anew.

    Args:
        text: Of the file.
        renamed: Of a key (`part`, `mesh` or `table`) and the name behind it, the new name.
    """
    found = {node.start_mark.index: (key, node) for key, node in _references(yaml.compose(text, yaml.SafeLoader))}
    for start, (key, node) in sorted(found.items(), reverse=True):
        new = renamed(key, node.value)
        if new != node.value:
            text = text[:start] + _flow(new) + text[node.end_mark.index :]
    return text


def _references(node: yaml.Node | None) -> Iterator[tuple[str, yaml.ScalarNode]]:
    """Keys and nodes of the files that a node names."""
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _references(item)
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        named = value.value if isinstance(value, yaml.SequenceNode) and key.value == "table" else [value]
        for one in named:
            if key.value in ("part", "mesh", "table") and isinstance(one, yaml.ScalarNode) and one.tag == _TEXT:
                yield key.value, one
        yield from _references(value)


def _listed(text: str, name: str, where: str) -> yaml.SequenceNode | None:
    """The node of a top-level list, such as `parts`; None where the file has none."""
    parse_yaml(text, where)  # so that mistakes are said as everywhere
    root = yaml.compose(text, yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    node = next((value for key, value in root.value if key.value == name), None)
    if node is None:
        return None
    items = node.value if isinstance(node, yaml.SequenceNode) else []
    places = [node.start_mark.index, *(item.start_mark.index for item in items)]
    # What an alias stands for is elsewhere in the file.
    if not isinstance(node, yaml.SequenceNode) or places != sorted(places):
        raise ConfigError(f"{where}: {name} is not a plain list (is there an alias, *name?): edit the file by hand")
    return node


def _name(item: yaml.Node) -> str:
    pairs = item.value if isinstance(item, yaml.MappingNode) else []
    return next((str(value.value) for key, value in pairs if key.value == "name"), "?")


def _last_line(node: yaml.Node) -> int:
    """Number of the last line with something of a node; a block's own end lies behind the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        children = [one for item in node.value for one in (item if isinstance(item, tuple) else (item,))]
        # What an alias stands for is elsewhere in the file.
        return max(_last_line(child) for child in children if child.start_mark.index >= node.start_mark.index)
    return node.end_mark.line if node.end_mark.column > 0 else node.end_mark.line - 1


def _dash(text: str, item: yaml.Node) -> yaml.Mark:
    """Where the dash of an item of a block list is; it may have a line of its own."""
    marks = [token.start_mark for token in yaml.scan(text) if isinstance(token, yaml.BlockEntryToken)]
    return max((mark for mark in marks if mark.index < item.start_mark.index), key=lambda mark: mark.index)


def _before_dashes(text: str, first: yaml.Node) -> int:
    """Where the key of a block list ends, with its colon, tag and anchor."""
    kinds, dash = (yaml.ValueToken, yaml.TagToken, yaml.AnchorToken), _dash(text, first).index
    ends = [token.end_mark.index for token in yaml.scan(text) if isinstance(token, kinds)]
    return max(end for end in ends if end <= dash)


def _flow(value: Any) -> str:
    """Data as YAML in one line, with numbers and names as people write them."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    if isinstance(value, str):
        return value if _is_plain(value) else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)  # null, true, 3


def _is_plain(text: str) -> bool:
    """Whether text without quotes is read as that text."""
    try:
        return parse_yaml(f"x: [{text}]", "") == {"x": [text]}
    except ConfigError:
        return False


def written(data: dict[str, Any]) -> str:
    """Data of a vehicle file as short YAML: a line per key and per part."""
    lines = []
    for key, value in data.items():
        if isinstance(value, list) and value:
            lines += [f"{key}:", *(f"  - {_flow(item)}" for item in value)]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"
