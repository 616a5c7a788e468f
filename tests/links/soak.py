"""The served twin under clients that take all they can get: memory and jitter over time.

`python -m tests.links.soak --minutes 60` prints a line a minute and one JSON object at the end.
"""

import argparse
import json
import multiprocessing
import os
import sys
import threading
import time

import numpy as np

HOSTS, HTTP = ("127.0.0.60", "127.0.0.61"), 8760
FAST = ("DepthTel", "AttitudeTel", "Imu1Tel", "Imu2Tel", "CalibratedImuTel", "ControlForceTel", "DvlVelocityTel")


def resident(pid: int) -> float:
    """Memory of a process [MB]."""
    with open(f"/proc/{pid}/statm") as stream:
        return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def client(until: float, counted) -> None:
    """The vendor's SDK on both drones, all it can ask for at 100 Hz, sticks moved all the time."""
    import blueye.protocol as bp
    from blueye.sdk import Drone

    os.environ["http_proxy"] = f"http://{HOSTS[0]}:{HTTP}"
    drones = [Drone(ip) for ip in HOSTS]

    def take(name: str, payload: bytes) -> None:
        counted.value += 1

    for drone in drones:
        for name in FAST:
            drone.telemetry.set_msg_publish_frequency(getattr(bp, name), 100)
        drone.telemetry.add_msg_callback([], take, raw=True)
    while time.time() < until:
        for drone in drones:
            drone.motion.set_surge(0.3 * np.sin(0.5 * time.time()))
            drone.motion.set_heave(0.1 * np.sin(0.3 * time.time()))
        time.sleep(0.05)
    for drone in drones:
        drone.disconnect()


def soak(minutes: float, say=print) -> dict:
    """Serve and listen for so long; memory of both processes [MB] once a minute from the first one on, and the pace."""
    from rovtwin.links.servers.protocol_process import Protocols
    from rovtwin.live.serving import serve as module
    from rovtwin.live.serving.host import ServedVehicle
    from rovtwin.live.serving.protocols import places_of, servers_of, world_for

    scenario = world_for("double_blueye", [], None)
    vehicle = ServedVehicle(scenario)
    servers = servers_of(["blueye"], scenario, vehicle, places_of(["blueye"], [f"{h}:{HTTP}" for h in HOSTS])).values()
    pids: list[int] = []

    class Known(Protocols):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            pids.append(self.pid)

    module.Protocols = Known
    counted = multiprocessing.get_context("spawn").Value("q", 0)
    until = time.time() + 60 * minutes + 5
    listener = multiprocessing.get_context("spawn").Process(target=client, args=(until, counted), daemon=True)
    memory: list[tuple[float, float, float]] = []

    def watch() -> None:
        listener.start()
        began = time.time()
        while time.time() < until:
            time.sleep(min(60.0, 6.0 * minutes))
            if time.time() > until:
                return
            row = ((time.time() - began) / 60, resident(os.getpid()), resident(pids[0]))
            memory.append(row)
            say(f"{row[0]:6.1f} min  physics {row[1]:.1f} MB  protocols {row[2]:.1f} MB  {counted.value} messages")
            sys.stdout.flush()

    thread = threading.Thread(target=watch, daemon=True)

    def begin(text: str) -> None:
        say(text)
        if not thread.is_alive():
            thread.start()

    pace = module.serve(vehicle, servers, say=begin, over=lambda: time.time() > until)
    thread.join(120)
    listener.join(10)
    rows = np.array(memory)
    growth = {
        name: float(np.polyfit(rows[:, 0], rows[:, i], 1)[0] * 60) if len(rows) > 2 else None
        for i, name in ((1, "physics_mb_per_hour"), (2, "protocols_mb_per_hour"))
    }
    messages = counted.value / max(60 * minutes, 1)
    return {
        "minutes": minutes,
        **pace.figures(),
        **growth,
        "messages_per_s": messages,
        "memory": rows.round(1).tolist(),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    print(json.dumps(soak(parser.parse_args().minutes)))
