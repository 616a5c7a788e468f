"""How far off a survey's track and mosaic are, and whether what is stated of them is true: over many seeds.

python -m benchmarks.surveys --aid dvl --seeds 1-20 -o build/surveys
python -m benchmarks.surveys --aid positions --seeds 1-20 -o build/surveys

Each seed is a flight of 10 x 6 m by `double_blueye`, 1.5 m over hills, with a position of 0.5 m once a second, and a
Doppler log or not. Its log is smoothed three times: as it is (the twin's compass and log are exact), with the compass
1 deg off, and with constants of compass and log drawn from what the smoother takes them to be. Then points all over
the mosaic are placed: by the smoothed track, registered by one tie a metre of 1 cm with and without a tenth of false
ones, with four known points of 5 mm, and with a boresight of 1 deg that nobody stated. Floor and mount are known else.

A row for each is added to `AID.jsonl`, with the version of the code; rows that are there are not made again. The table
is printed at the end, and says so where its rows are of several versions.
Two minutes of processor time a seed.
"""

import argparse
import json
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.imaging.helper import DOWN, imager
from tests.mapping.overlaps import Strip, ideal_ties, known_points, with_false
from tests.mapping.surveys import EXACT, LEVER, Hills

from rovtwin.api import load_scenario
from rovtwin.core.log import Log
from rovtwin.gnc.navigation.constants import USUAL_STD
from rovtwin.imaging.imager import Mount
from rovtwin.mapping.alignment.calibration import calibration_findings
from rovtwin.mapping.alignment.ground_points import ground_points
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.alignment.registration import register
from rovtwin.mapping.alignment.strips import straight_runs
from rovtwin.mapping.alignment.ties import observe
from rovtwin.mapping.alignment.uncertainty import point_uncertainty
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.navigation import Navigation
from rovtwin.runs.fly import fly
from rovtwin.runs.smooth import SmoothedRun, smooth_run

LENGTH, APART, LINES, SPEED = 10.3, 1.07, 5, 0.2
SETTLED = 15.0  # [s]
CORNERS = [[0.5, 1.0], [9.8, 1.0], [0.5, 5.0], [9.8, 5.0]]  # of the known points [m]
BORESIGHT = np.radians([1.0, -1.0, 1.0])
ALIGNED = EXACT | {
    "boresight_roll": np.radians(1.0),
    "boresight_pitch": np.radians(1.0),
    "boresight_yaw": np.radians(1),
}
EXACT_SENSORS = dict.fromkeys(USUAL_STD, 0.0)
Off = dict[str, float]


def scenario(aid: str) -> dict[str, Any]:
    """Lines to and fro."""
    ends = [(-1.0, 10.3), (11.0, -0.3)]
    points = [[ends[k % 2][i], 0.865 + k * APART, 3.5] for k in range(LINES) for i in range(2)]
    return {
        "name": f"survey_{aid}",
        "vehicle": "double_blueye",
        "duration": 660.0,
        "start": {"position": [-1.0, 0.865, 0.5], "heading_deg": 0.0},
        "world": {"floor": 5.0},
        "autopilot": {"type": "model_based"},
        "sensors": {"dvl": True} if aid == "dvl" else {},
        "mission": {
            "name": "survey",
            "waypoints": [{"position": p, "acceptance": 0.2, "speed": SPEED} for p in points],
        },
        "battery": {},
    }


def put_off(log: Log, off: Off, path: Path) -> None:
    """The same log, with constant errors in the readings of compass and Doppler log."""
    data = {name: (log[name].t, log[name].values.copy()) for name in log}
    data["sensor/attitude"][1][:, 2] += off["heading"]
    if "sensor/dvl" in data:
        values, c, s = data["sensor/dvl"][1], np.cos(off["dvl_yaw"]), np.sin(off["dvl_yaw"])
        u, v = values[:, 0].copy(), values[:, 1].copy()
        values[:, 0], values[:, 1] = c * u + s * v, c * v - s * u
        values[:, :3] *= 1.0 + off["dvl_scale"]
    path.unlink(missing_ok=True)
    Log.from_arrays([log.channels[name] for name in log], data, log.metadata).write(path)


def squared(e: NDArray[Any], P: NDArray[Any]) -> float:
    """Mean of the normalised squares of errors in the plane: 2 where P is right."""
    return float(np.mean(np.einsum("mi,mij,mj->m", e, np.linalg.inv(P), e)))


def rms(e: NDArray[Any]) -> float:
    return float(np.sqrt(np.mean(np.sum(e**2, axis=-1))))


def track_row(run: SmoothedRun, truth: Any) -> dict[str, Any]:
    """Of the smoothed track: error, what is stated of it, NEES, constants."""
    at = np.clip(np.searchsorted(run.track.t, truth.t - 1e-9), 0, len(run.track.t) - 1)
    late = truth.t > SETTLED
    e, P = (run.track.eta[at] - truth.values)[late, :2], run.track.covariance[at][late, :2, :2]
    keys = run.track.keys
    sd = np.sqrt(np.diag(keys.constants_covariance))
    return {
        "rms": rms(e),
        "stated": float(np.sqrt(np.mean(np.trace(P, axis1=1, axis2=2)))),
        "nees": squared(e, P),
        "constants": dict(zip(keys.constants, zip(keys.constants_value, sd, strict=True), strict=True)),
    }


class Mosaic:
    """Points all over the floor, where they are, and where a track places them."""

    def __init__(self, log: Log, run: SmoothedRun, misaligned: NDArray[Any] | None = None):
        lens = imager(pixels=484, port=None, lens={"field_of_view_deg": 60.0})
        self.mount = Mount(LEVER, DOWN, "uhi.camera")
        turn = Rotation.from_rotvec(np.zeros(3) if misaligned is None else misaligned).as_matrix()
        flown = Navigation.of_log(log, "truth")
        self.truth = Georeference(lens, Mount(LEVER, turn @ DOWN, "uhi.camera"), flown, Hills())
        self.stated = Georeference(lens, self.mount, Navigation.of_log(run.log, "smoothed"), Hills())
        t = np.arange(SETTLED, flown.t[-1] - 1.0, 0.25)
        self.runs = [(float(t[k[0]]), float(t[k[-1]])) for k in straight_runs(flown, t) if t[k[-1]] - t[k[0]] > 30.0]
        self.strips = [Strip(self.truth, a + 0.2, b - 0.2, 0.5) for a, b in self.runs]
        self.keys = run.track.keys

    def joint(self, prior: dict[str, float]) -> JointErrors:
        return JointErrors.of(self.keys, self.runs[0][0], self.runs[-1][1], prior)

    def errors(self, joint: JointErrors, mend: bool) -> dict[str, float]:
        t = np.concatenate([np.arange(a + 0.5, b - 0.5, 1.5) for a, b in self.runs])
        t, pixel = (x.ravel() for x in np.meshgrid(t, np.linspace(2, 481, 5), indexing="ij"))
        where, later = self.stated, 0.0
        if mend:
            mount, later = joint.mounted(where.mount)
            where = Georeference(where.imager, mount, joint.applied(where.navigation), where.floor)
        seen = ground_points(where, t + later, pixel)
        e = (seen.point - ground_points(self.truth, t, pixel).point)[:, :2]
        good = np.isfinite(e).all(1)
        known = point_uncertainty(joint, seen)
        within = e[good] - e[good].mean(0)
        return {
            "rms": rms(e[good]),
            "within": rms(within),
            "nees": squared(e[good], known.absolute[good]),
            "nees_within": squared(within, known.within[good]),
            "stated": float(np.sqrt(np.mean(known.sigma()[good] ** 2))),
            "stated_within": float(np.sqrt(np.mean(known.sigma("within")[good] ** 2))),
        }


def mosaic_rows(mosaic: Mosaic, seed: int, prior: dict[str, float], short: bool) -> Iterator[dict[str, Any]]:
    """Placed by the track alone, registered, and with known points; unless `short`, with false ties too."""
    rng = np.random.default_rng(seed)
    ties = ideal_ties(mosaic.strips, rng)
    points = known_points(mosaic.strips, CORNERS, rng)
    joint = mosaic.joint(prior)
    yield {"how": "track"} | mosaic.errors(joint, False)
    cases: list[tuple[str, Any, Any]] = [("ties", ties, None), ("ties, points", ties, points)]
    if not short:
        mixed, bad = with_false(ties, 0.1, rng)
        cases += [("10 % false", mixed, None), ("10 % false, points", mixed, points)]
    for how, some, known in cases:
        done = register(joint, observe(joint, mosaic.stated, some, known))
        row = {"how": how, "nis": done.nis, "ties": len(some.t), "dropped": done.dropped}
        if "false" in how:
            row["missed"] = int(done.used[bad].sum())
        if prior is ALIGNED:
            found = [one for one in calibration_findings(joint, done.joint) if one.name.startswith("bore")]
            row["boresight"] = [(one.value, one.std, bool(one.refused)) for one in found]
        yield row | mosaic.errors(done.joint, True)


def rows_of(aid: str, seed: int, folder: Path) -> Iterator[dict[str, Any]]:
    """All of one seed."""
    run = folder / f"{aid}_{seed}"
    if not (run / "log.mcap").exists():
        fly(load_scenario(scenario(aid), seed=seed), run)
    kept = run / "as_flown.mcap"
    if not kept.exists():
        (run / "log.mcap").rename(kept)
    log = Log.read(kept)
    drawn = {name: float(sd * np.random.default_rng(seed).normal()) for name, sd in USUAL_STD.items()}
    none = dict.fromkeys(USUAL_STD, 0.0)
    for what, off, trust in (
        ("exact, known to be", none, EXACT_SENSORS),
        ("exact", none, {}),
        ("compass 1 deg off", none | {"heading": np.radians(1.0)}, {}),
        ("drawn", drawn, {}),
    ):
        put_off(log, off, run / "log.mcap")
        smoothed = smooth_run(run, trust)
        yield {"sensors": what, "how": "smoothed"} | track_row(smoothed, log["truth/eta"])
        for row in mosaic_rows(Mosaic(log, smoothed), seed, EXACT, what == "compass 1 deg off"):
            yield {"sensors": what} | row
        if what in ("exact, known to be", "drawn"):
            for row in mosaic_rows(Mosaic(log, smoothed, BORESIGHT), seed, ALIGNED, True):
                yield {"sensors": f"{what}; boresight off"} | row


def version_of_code() -> str:
    """The commit; "" outside a repository."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def show(rows: list[dict[str, Any]]) -> None:
    """Means over seeds: rms in mm, NEES, NIS; and the ranges of single seeds."""
    if len(versions := sorted({row.get("code", "") for row in rows})) > 1:
        print(f"rows are of several versions of the code: {', '.join(one or 'unknown' for one in versions)}")
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["sensors"], row["how"]].append(row)
    print(f"{'':50s}   n   rms  stated  NEES  within stated  NEES   NIS  missed")
    for (sensors, how), some in groups.items():

        def mean(name: str, power: float = 1.0, scale: float = 1.0, some: Any = some) -> str:
            values = [row[name] for row in some if name in row]
            return f"{scale * np.mean(np.power(values, power)) ** (1 / power):6.2f}" if values else "     -"

        size = [mean(name, 2.0, 1e3) for name in ("rms", "stated", "within", "stated_within")]
        print(
            f"{sensors + ': ' + how:50s} {len(some):3d} {size[0]} {size[1]} {mean('nees')} {size[2]} {size[3]} "
            f"{mean('nees_within')} {mean('nis')} {mean('missed')}"
        )
        ranges = {name: [row[name] for row in some if name in row] for name in ("nees", "within")}
        texts = (
            f"{name} {scale * min(values):.2g} to {scale * max(values):.2g}"
            for (name, values), scale in zip(ranges.items(), (1.0, 1e3), strict=True)
            if values
        )
        print(f"    single seeds: {', '.join(texts)}")
        _show_boresight([row["boresight"] for row in some if "boresight" in row])


def _show_boresight(found: list[Any]) -> None:
    if not found:
        return
    values = np.array(found, float)
    off = values[..., 0] - BORESIGHT
    print(
        f"    boresight: rms error {np.degrees(np.sqrt((off**2).mean(0))).round(3)} deg, worst "
        f"{np.degrees(np.abs(off).max(0)).round(3)}, worst in its sd {(np.abs(off) / values[..., 1]).max(0).round(2)}, "
        f"refused {values[..., 2].sum(0).astype(int)} of {len(values)}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aid", choices=["dvl", "positions"], default="dvl")
    parser.add_argument("--seeds", default="1-20", help="first-last")
    parser.add_argument("-o", "--out", type=Path, required=True)
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("-")
    path: Path = arguments.out / f"{arguments.aid}.jsonl"
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    code = version_of_code()
    for seed in range(int(first), int(last or first) + 1):
        if any(row["seed"] == seed for row in rows):
            continue
        new = [{"seed": seed, "code": code} | row for row in rows_of(arguments.aid, seed, arguments.out)]
        rows += new
        with path.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(row) + "\n" for row in new)
        print(f"seed {seed}: done", flush=True)
    show(rows)


if __name__ == "__main__":
    main()
