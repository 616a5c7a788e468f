"""Names are words of the field: a reading is received, a command is sent, a state is estimated.

The sources are parsed, not imported. docs/glossary.md has the words that are used instead.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Words that no name may have, and what is meant by them in most places.
PRIVATE = {
    "believed": "estimated, accepted",
    "believes": "estimates",
    "heard": "received",
    "said": "given, reported, text, messages",
    "told": "reported, sent, published",
    "unsaid": "unreported",
    "wanted": "desired, requested, required, expected",
    "wish": "command, request",
    "wished": "commanded, requested",
    "wishes": "commands, requests",
}
FOLDERS = ("src", "tests", "benchmarks", "examples", "docs")
PARTS = re.compile(r"[a-z]+|[A-Z]+(?![a-z])|[A-Z][a-z]+|[0-9]+")
SCRIPTS = "src/rovtwin/console/web/static"
COMMENT = re.compile(r"/\*.*?\*/|(?<!:)//[^\n]*", re.DOTALL)


def private_words(name: str) -> set[str]:
    """The words of a name, in snake or camel case, that it may not have."""
    return {part.lower() for part in PARTS.findall(name)} & PRIVATE.keys()


def names_of(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of whatever a module defines or uses by name, names of its imports too."""
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 0)
        for field in ("id", "attr", "arg", "name", "asname", "module", "rest"):
            if isinstance(name := getattr(node, field, None), str):
                yield line, name
        for field in ("names", "kwd_attrs"):
            yield from ((line, name) for name in getattr(node, field, ()) if isinstance(name, str))


def mistakes(places: Iterator[tuple[int, str]], where: str) -> list[str]:
    return [
        f"{where}:{line}: {name!r}: say {' or '.join(PRIVATE[word] for word in sorted(words))}"
        for line, name in places
        if (words := private_words(name))
    ]


def test_names_and_their_parts_are_seen():
    source = "def is_said(wish, *, k=heardAt):\n    self.TOLD = f'{wanted}'\n    global _wished\n    g(believed=1)"
    found = mistakes(names_of(ast.parse(source)), "x.py")
    assert {line.split("'")[1] for line in found} == {
        "is_said", "wish", "heardAt", "TOLD", "wanted", "_wished", "believed"
    }  # fmt: skip
    assert not private_words("unwanted_wishbone") and not private_words("saidpur")


@pytest.mark.parametrize("folder", FOLDERS)
def test_names_in_python_are_words_of_the_field(folder):
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        where = path.relative_to(ROOT).as_posix()
        found += mistakes(names_of(ast.parse(path.read_text(), where)), where)
        found += mistakes(iter([(0, path.stem)]), where)
    assert not found, "\n".join(found)


def test_names_in_scripts_of_the_console_are_words_of_the_field():
    found = []
    for path in sorted((ROOT / SCRIPTS).glob("*.js")):
        code = COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), path.read_text())
        places = ((k, name) for k, line in enumerate(code.splitlines(), 1) for name in re.findall(r"\w+", line))
        found += mistakes(places, path.name)
    assert not found, "\n".join(found)
