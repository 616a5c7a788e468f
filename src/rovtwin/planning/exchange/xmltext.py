"""XML from anybody: read by the standard library, without what makes files of a few lines fill any memory."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

from rovtwin.core.errors import ConfigError

DEEPEST = 32  # elements within each other; routes of plotters and of Google Earth have some ten


class _Builder(TreeBuilder):
    """Builds a tree of bounded depth, without a document type."""

    def __init__(self, where: str):
        super().__init__()
        self._where, self._depth = where, 0

    def start(self, tag: str, attributes: dict[str, str], /) -> Element:
        self._depth += 1
        if self._depth > DEEPEST:
            raise ConfigError(f"{self._where}: found elements nested deeper than {DEEPEST} levels, expected a route")
        return super().start(tag, attributes)

    def end(self, tag: str, /) -> Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, *_: str | None) -> None:
        raise ConfigError(
            f"{self._where}: declares a document type (<!DOCTYPE), whose entities can fill any memory and which no "
            "route needs; delete that, or export the file anew"
        )


def parse_xml(text: str, where: str) -> Element:
    """The root of a document.

    Raises:
        ConfigError: It is no XML, declares types or entities of its own, or is nested too deeply.
    """
    parser = XMLParser(target=_Builder(where))
    try:
        parser.feed(text)
        return parser.close()
    except ParseError as error:
        line, column = error.position
        raise ConfigError(f"{where}: line {line}, column {column + 1}: not XML ({error.msg.split(':')[0]})") from None
    except UnicodeEncodeError as error:  # half of a pair of UTF-16, which JSON lets pass
        raise ConfigError(f"{where}: character {error.start + 1}: not text that XML may hold") from None


def local(element: Element) -> str:
    """An element's name without its namespace: versions of a format differ in that."""
    return element.tag.rpartition("}")[2]


def every(root: Element, name: str) -> Iterator[Element]:
    """Elements of a name below another, in the order of the document."""
    return (element for element in root.iter() if local(element) == name)


def children(parent: Element, name: str) -> list[Element]:
    """Elements of a name right below another."""
    return [element for element in parent if local(element) == name]


def text_of(parent: Element, name: str) -> str:
    """Text of the first such element right below another; "" where there is none."""
    return next(((element.text or "").strip() for element in children(parent, name)), "")


def number_of(text: str, where: str) -> float:
    """A number that a text is.

    Raises:
        ConfigError: It is none.
    """
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f"{where}: found {text[:40]!r}, expected a number") from None
