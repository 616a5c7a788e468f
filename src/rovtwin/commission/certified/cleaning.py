"""Files that are passed on say nothing of the machine they were made on: its folders and users are taken out."""

import re
import shutil
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit, urlunsplit

from rovtwin.core.errors import RovtwinError
from rovtwin.core.log import Log
from rovtwin.core.user_files.files import write_bytes
from rovtwin.identification.result import Identification

TEXTS = (
    ".yaml",
    ".yml",
    ".json",
    ".csv",
    ".txt",
    ".md",
    ".html",
    ".svg",
    ".xml",
    ".params",
    ".geojson",
    ".gpx",
    ".kml",
)
_REST = r"""(?:[/\\][^\s"'<>|:,;)\]}]*)?"""  # of a path behind a folder that is known
# Homes of other people and machines: a vehicle file may have come from elsewhere.
_HOMES = r"""(?:/(?:home|Users)/[^/\s"'<>|:,;)\]}]+|/root|[A-Za-z]:\\+Users\\+[^\\\s"'<>|:,;)\]}]+)"""


class Cleaner:
    """Takes paths of this machine out of texts and logs.

    Args:
        inside: Folder whose files keep their way in it: what lies in it is in the bundle.
        more: Other folders of which only the last name of a path is kept.
    """

    def __init__(self, inside: Path, more: Iterable[Path] = ()):
        self._inside = sorted({str(inside.absolute()), str(inside.resolve())}, key=len, reverse=True)
        places = (Path.home(), Path.cwd(), Path(tempfile.gettempdir()), Path(sys.prefix), _PACKAGE, *more)
        roots = {str(place) for one in places for place in (one.absolute(), one.resolve())}
        self._roots = sorted((root for root in roots if len(Path(root).parts) > 1), key=len, reverse=True)
        known = "|".join(re.escape(root) for root in self._roots)
        inner = "|".join(re.escape(root) for root in self._inside)
        self._inner = re.compile(rf"(?:{inner})(?:/|(?![\w.\-]))")
        # Not behind a letter or a dot: `https://host/home/..` and `../home/x` are no paths of this machine.
        self._outer = re.compile(rf"(?<![\w.\-])(?:{known}|{_HOMES})(?![\w.\-]){_REST}")

    def text(self, text: str) -> str:
        """The text with what is left of each path: its way in the bundle, or the name of the file."""
        return self._outer.sub(lambda found: re.split(r"[/\\]+", found[0].rstrip("/\\"))[-1], self._inner.sub("", text))

    def copy(self, source: Path, target: Path) -> str:
        """Copy a file without paths of this machine; what was done about it: "", `cleaned`, or why it was left out."""
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.suffix.lower() in TEXTS:
            return self._copy_text(source, target)
        if source.suffix.lower() == ".mcap" and (done := self._copy_log(source, target)) is not None:
            return done
        if not self._tells(source):
            shutil.copyfile(source, target)
            return ""
        if source.suffix.lower() == ".nc" and self._copy_result(source, target):
            return "cleaned"
        return f"{source.name} names folders of the machine it was made on, and cannot be changed"

    def _copy_text(self, source: Path, target: Path) -> str:
        content = source.read_bytes()
        try:
            text = content.decode()
        except UnicodeDecodeError:
            return f"{source.name} is no text in UTF-8, so that it could not be looked through"
        clean = self.text(text).encode()
        write_bytes(target, clean)
        return "" if clean == content else "cleaned"

    def _copy_log(self, source: Path, target: Path) -> str | None:
        """As `copy`; None of what is no finished log of ours. Data stay what they are, to the last bit."""
        try:
            log = Log.read(source)
        except RovtwinError:
            return None
        clean = {key: self.text(value) for key, value in log.metadata.items()}
        if clean == log.metadata:
            shutil.copyfile(source, target)
            return ""
        log.metadata.update(clean)
        log.write(target, overwrite=True)
        return "cleaned"

    def _copy_result(self, source: Path, target: Path) -> bool:
        """Whether it was a saved identification, and tells nothing any more; its figures stay to the last bit."""
        try:
            result = Identification.load(source)
        except RovtwinError:
            return False
        records = [one | {"notes": [self.text(note) for note in one["notes"]]} for one in result.records]
        findings, doubts = ([self.text(line) for line in lines] for lines in (result.findings, result.doubts))
        replace(result, records=records, findings=findings, doubts=doubts).save(target, overwrite=True)
        if self._tells(target):
            target.unlink()
            return False
        return True

    def _tells(self, path: Path) -> bool:
        """Whether a file's bytes hold a path of this machine."""
        needles = [root.encode() for root in (*self._roots, *self._inside)]
        longest, before = max(map(len, needles)), b""
        with open(path, "rb") as stream:
            while piece := stream.read(1 << 22):
                if any(needle in before + piece for needle in needles):
                    return True
                before = piece[-longest:]
        return False


def public_url(url: str) -> str:
    """A link's address without a user's name and password."""
    parts = urlsplit(url)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2])) if "@" in parts.netloc else url


_PACKAGE = Path(__file__).parents[2]
