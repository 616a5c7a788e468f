"""Markdown tables of scores, from what `rovtwin score ... --json` printed.

rovtwin score --vehicle double_blueye --autopilot thesis --seeds 1-10 --json > scores.json
python docs/scripts/scores.py scores.json [more.json ...]
"""

import json
import sys
from pathlib import Path

from rovtwin.runs.batch import COLUMNS, table_row


def table(result: dict) -> str:
    """One file's scenarios as a table with a heading."""
    heads = ["scenario", *(" ".join(column.split()) for column in COLUMNS)]
    vehicle, autopilot = (result[key] or "as the scenario says" for key in ("vehicle", "autopilot"))
    lines = [
        f"**`{vehicle}`, autopilot `{autopilot}`**, seeds {result['seeds'][0]} to {result['seeds'][-1]}",
        "",
        "| " + " | ".join(heads) + " |",
        "|" + "---|" * len(heads),
    ]
    for name, runs in result["scenarios"].items():
        cells = [cell.replace("nan", "–") for cell in table_row(runs)]
        lines.append("| " + " | ".join([f"`{name}`", *cells]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print("\n\n".join(table(json.loads(Path(name).read_text())) for name in sys.argv[1:]))
