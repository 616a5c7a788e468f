"""What stages say in the words of the command line, in those of a page: its fields and its buttons."""

import re
from collections.abc import Mapping

FIELDS = {
    "minutes": "Most minutes of test flying",
    "interval": "Test until damping is known to",
    "prior": "Earlier identified file",
    "sensor": "Instruments beside it",
}
WHERE = " See What is asked for."
AGAIN = "Give the same command again: it repeats that stage."
OPTION = re.compile(rf"--({'|'.join(FIELDS)})\b")
STAGE = re.compile(r"--stage (\w+)")


def of_page(text: str, titles: Mapping[str, str]) -> str:
    """A text for who has a page and no terminal.

    Args:
        text: Of a check.
        titles: Of stages, by their names.
    """
    text = text.replace(AGAIN, "Start it again.").replace("--tank", "tank")
    text = STAGE.sub(lambda found: f"start {titles.get(found[1], found[1])} again", text)
    shown = OPTION.sub(lambda found: f"“{FIELDS[found[1]]}”", text)
    return shown + (WHERE if shown != text else "")
