"""`python -m rovtwin.console.engine`: the process that `rovtwin console` starts, and that outlives it."""

import argparse
import json
import logging
import multiprocessing
import os
import signal
import sys
from pathlib import Path

from rovtwin.console.locks import Lock
from rovtwin.console.wire import Place

PATIENCE = 1.0  # with a process that is to end [s]


def main() -> None:
    """Fly until an operator says quit, or somebody ends the process."""
    parser = argparse.ArgumentParser(prog="rovtwin.console.engine")
    parser.add_argument("--place", type=Path, required=True)
    parser.add_argument("--scenario", type=Path, required=True)
    parser.add_argument("--link", default="twin://")
    parser.add_argument("--sensor", action="append", default=[])
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    given = parser.parse_args()
    place = Place(given.place)
    logging.basicConfig(level=logging.WARNING)
    if not Lock(place.lock).take():  # until this process is gone: ending may take a while
        sys.exit(f"{place.folder}: an engine is there already")
    note = {"pid": os.getpid(), "link": given.link}
    place.note.write_text(json.dumps(note), encoding="utf-8")

    from rovtwin.console.engine.bridge import Bridge
    from rovtwin.console.engine.engine import Engine
    from rovtwin.console.engine.vehicle_session import EngineConfig
    from rovtwin.live.connect import as_read
    from rovtwin.scenario.files import load_scenario

    scenario = as_read(given.link, load_scenario(str(given.scenario), (), None))
    note["scenario"] = scenario.name
    place.note.write_text(json.dumps(note), encoding="utf-8")
    config = EngineConfig(scenario, given.link, tuple(given.sensor), place.stop, place.commissioning)
    engine = Engine(config, place.news, given.speed, given.runs)
    bridge = Bridge(engine, place.orders)

    def end(*_: object) -> None:
        engine.over = True

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, end)
    try:
        engine.run(bridge.obey, bridge.wait)
    finally:
        bridge.close()
        place.note.unlink(missing_ok=True)
    if engine.is_making_ready:
        _leave()


def _leave() -> None:
    """End at once: Python would wait for what is being compiled, and for the link's host to be there."""
    for one in multiprocessing.active_children():
        one.terminate()
        one.join(PATIENCE)
        one.kill()
    os._exit(0)


if __name__ == "__main__":
    main()
