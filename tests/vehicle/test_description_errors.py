"""Bad vehicle files: each gives one clear message, whatever it is that is wrong."""

import numpy as np
import pytest
import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle import load_vehicle

GOOD = {"name": "v", "description": "d", "mass": 5.0, "shape": {"sphere": 0.1}}
T = {"name": "t", "direction": [1, 0, 0], "force": 10.0}


def coupled(size):
    D = np.diag([5.0, 5, 5, 1, 1, 1])
    D[0, 1] = D[1, 0] = size
    return D.tolist()


CASES = {
    "unknown key": ({"thrusters": [T | {"gian": 1}]}, "v.yaml: thrusters[0].gian: no such key."),
    "unknown key, near": ({"thrusters": [T | {"dead_bnad": 1}]}, "no such key. Did you mean 'dead_band'?"),
    "deep": ({"parts": [{"name": "a", "parts": [{"name": "b", "mas": 1}]}]}, "parts[0].parts[0].mas: no such key."),
    "no name": ({"parts": [{"mass": 1.0}]}, "v.yaml: parts[0].name: missing"),
    "negative mass": ({"mass": -3}, "v.yaml: mass: found -3, expected a number greater than 0"),
    "zero mass": ({"mass": 0}, "mass: found 0, expected a number greater than 0"),
    "mass with unit": ({"mass": "5 kg"}, "found '5 kg', expected a number; units are fixed (SI) and are not written"),
    "NaN": ({"mass": float("nan")}, "mass: found nan, expected a finite number"),
    "infinite": ({"volume": float("inf")}, "volume: found inf, expected a finite number"),
    "negative volume": ({"volume": -0.1}, "volume: found -0.1, expected a number of at least 0"),
    "inertia negative": ({"inertia": [1, -1, 1]}, "inertia: not positive definite"),
    "inertia products": ({"inertia": [1, 1, 1, 2, 0, 0]}, "inertia: not positive definite"),
    "inertia triangle": ({"inertia": [1, 1, 3]}, "inertia: no body has principal moments 1, 1, 3 kg m2"),
    "inertia asymmetric": ({"inertia": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]}, "inertia: the matrix is not symmetric"),
    "inertia NaN": ({"inertia": [1, 1, float("nan")]}, "inertia: found nan, expected finite numbers"),
    "inertia count": ({"inertia": [1, 2]}, "inertia: found 2 numbers, expected 3 (xx, yy, zz), 6"),
    "inertia ragged": ({"inertia": [[1, 2], [1]]}, "inertia: found 2 rows, expected 3"),
    "inertia word": ({"inertia": ["a", 1, 1]}, "inertia: found 'a' among the numbers"),
    "inertia scalar": ({"inertia": 3}, "inertia: found 3, expected 3"),
    "rigid body": ({"rigid_body": {"inertia": [1, 1, 9]}}, "rigid_body.inertia: no body has"),
    "two numbers": ({"center_of_gravity": [0, 0]}, "center_of_gravity: found 2 values, expected 3"),
    "boolean": ({"center_of_gravity": [True, 0, 0]}, "center_of_gravity[0]: found True, expected a number"),
    "noise per axis": (
        {"sensors": [{"name": "d", "kind": "dvl", "noise": [0.1, -0.1, 0.1]}]},
        "sensors[0].noise[1]: found -0.1, expected a number of at least 0",
    ),
    "axes": (
        {"sensors": [{"name": "p", "kind": "pressure", "noise": [0.1, 0.1]}]},
        "sensors[0]: found 2 numbers for noise of kind pressure, expected 1",
    ),
    "imu figures": (
        {"sensors": [{"name": "imu", "kind": "imu", "noise": 0.1}]},
        "sensors[0]: found noise of an imu, expected accelerometer: {noise: ..} or gyro: {..}",
    ),
    "gyro of a DVL": (
        {"sensors": [{"name": "d", "kind": "dvl", "gyro": {"noise": 0.1}}]},
        "sensors[0]: found gyro of a sensor of kind dvl, expected it of an imu only",
    ),
    "ranges": (
        {"sensors": [{"name": "a", "kind": "altimeter", "min_range": 5, "max_range": 2}]},
        "sensors[0]: found min_range 5 m and max_range 2 m: min_range has to be below max_range",
    ),
    "spare": (
        {"sensors": [{"name": "imu", "kind": "imu"}], "spare_sensors": ["ium"]},
        "v.yaml: spare_sensors: found 'ium', expected one of imu. Did you mean 'imu'?",
    ),
    "shape twice": ({"shape": {"sphere": 1, "box": [1, 1, 1]}}, "shape: found box and sphere, expected one of box"),
    "shape none": ({"shape": {}}, "shape: found none, expected one of box, cylinder, sphere, ellipsoid"),
    "shape flat": ({"shape": {"box": [1, 0, 1]}}, "shape.box[1]: found 0, expected a number greater than 0"),
    "attitude": ({"parts": [{"name": "a", "pose": {"attitude_deg": [0, 0, 400]}}]}, "a number of at most 360"),
    "density": ({"water_density": 1.025}, "water_density: found 1.025, expected a number of at least 900"),
    "same part": ({"parts": [{"name": "a"}, {"name": "a"}]}, "parts: the name 'a' is given twice; names must differ"),
    "hyphen": (
        {"thrusters": [T | {"name": "a-b"}]},
        "thrusters[0].name: found 'a-b', expected a letter, then letters, digits and _: logs are named after it",
    ),
    "part name": ({"parts": [{"name": "2nd"}]}, "parts[0].name: found '2nd', expected a letter, then letters"),
    "part name, dot": ({"parts": [{"name": "a.b"}]}, "parts[0].name: found 'a.b', expected a letter, then letters"),
    "part name, accent": ({"parts": [{"name": "hélice"}]}, "parts[0].name: found 'hélice', expected a letter"),
    "one name in logs": (
        {"thrusters": [T | {"name": "port_t"}], "parts": [{"name": "port", "thrusters": [T]}]},
        "v.yaml: the thrusters 'port_t' and 'port.t' are both 'port_t' in logs; rename one",
    ),
    "no tables": (
        {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": {}}}]},
        "curve.table: found {}, expected a CSV file",
    ),
    "same thruster": ({"thrusters": [T, T]}, "thrusters: the name 't' is given twice"),
    "part and mass": (
        {"parts": [{"name": "a", "part": "uhi", "mass": 2}]},
        "parts[0]: found 'part' and 'mass': a part from a file is described there; keep one",
    ),
    "part missing": (
        {"parts": [{"name": "a", "part": "blueye_pionee"}]},
        "v.yaml: parts[0].part: blueye_pionee: no such vehicle or device in the library",
    ),
    "part missing, near": ({"parts": [{"name": "a", "part": "uih"}]}, "Did you mean 'uhi'?"),
    "part file missing": ({"parts": [{"name": "a", "part": "w.yaml"}]}, "no such file. Did you mean 'v.yaml'?"),
    "itself": ({"parts": [{"name": "a", "part": "v.yaml"}]}, "cannot be a part of itself: v.yaml -> v.yaml"),
    "direction zero": ({"thrusters": [T | {"direction": [0, 0, 0]}]}, "direction: a direction of length zero"),
    "direction word": ({"thrusters": [T | {"direction": "up"}]}, "direction: found 'up', expected a vector of 3 or"),
    "direction key": ({"thrusters": [T | {"direction": {"azimuth": 3}}]}, "direction: found {'azimuth': 3}, expected"),
    "force negative": ({"thrusters": [T | {"force": -3}]}, "force: found -3, expected the size of the force"),
    "force keys": ({"thrusters": [T | {"force": {"ahead": 1}}]}, "force: found keys ['ahead'], expected 'ahead' and"),
    "no force": ({"thrusters": [{"name": "t", "direction": [1, 0, 0]}]}, "thrusters[0]: missing force"),
    "curve word": ({"thrusters": [T | {"curve": "square"}]}, "curve: found 'square', expected 'linear'"),
    "curve key": ({"thrusters": [T | {"curve": {"powr": 2}}]}, "curve.powr: no such key. Did you mean 'power'?"),
    "curve both": (
        {"thrusters": [T | {"curve": {"power": 2, "table": "x.csv"}}]},
        "curve: expected either 'power' or 'table'",
    ),
    "table and force": (
        {"thrusters": [T | {"curve": {"table": [[-1, -1], [0, 0], [1, 1]]}}]},
        "a table says force and dead band itself",
    ),
    "table not to 1": (
        {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": [[-1, -1], [0, 0], [0.9, 1]]}}]},
        "the commands of a table must increase from -1 to 1",
    ),
    "table falls": (
        {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": [[-1, 1], [0, 0], [1, -1]]}}]},
        "force falls with command",
    ),
    "table file": (
        {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": "t.csv"}}]},
        "t.csv: no such file",
    ),
    "dead band": ({"thrusters": [T | {"dead_band": 1.0}]}, "dead_band: found 1.0, expected a number less than 1"),
    "health": ({"thrusters": [T | {"health": 1.5}]}, "health: found 1.5, expected a number of at most 1"),
    "coefficients": ({"hydrodynamics": {"added_mass": [1, 2]}}, "added_mass: found 2 numbers, expected 6 numbers"),
    "sign": (
        {"hydrodynamics": {"linear_damping": [-5, 1, 1, 1, 1, 1]}},
        "linear_damping: negative for surge; coefficients are written positive (X_u = -5 is 5)",
    ),
    "null in matrix": (
        {"hydrodynamics": {"linear_damping": [[None] * 6] * 6}},
        "linear_damping: null is for the list of 6 only",
    ),
    "asymmetric added mass": (
        {"hydrodynamics": {"added_mass": (np.eye(6) + np.eye(6, k=1)).tolist()}},
        "hydrodynamics.added_mass is not symmetric",
    ),
    "M indefinite": (
        {"hydrodynamics": {"added_mass": (np.eye(6) + 40 * (np.eye(6, k=1) + np.eye(6, k=-1))).tolist()}},
        "M = M_RB + M_A is not positive definite",
    ),
    "driving damping": ({"hydrodynamics": {"linear_damping": coupled(6.0)}}, "the damping adds energy: at nu = ["),
    "buoyancy word": ({"restoring": {"buoyancy": "floating"}}, "buoyancy: found 'floating', expected a force [N] or"),
    "buoyancy twice": (
        {"restoring": {"buoyancy": 3, "net_buoyancy": 0}},
        "found buoyancy and net_buoyancy, expected one",
    ),
    "CB twice": (
        {"restoring": {"center_of_buoyancy": [0, 0, 0], "metacentric_height": 0.1}},
        "found center_of_buoyancy and metacentric_height, expected one",
    ),
    "net below zero": ({"restoring": {"net_buoyancy": -500}}, "restoring.net_buoyancy: -500 N less than the weight"),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_vehicle_file(case, tmp_path):
    changes, text = CASES[case]
    path = tmp_path / "v.yaml"
    path.write_text(yaml.safe_dump(GOOD | changes))
    with pytest.raises(ConfigError) as error:
        load_vehicle(path).model()
    assert text in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert str(error.value).startswith("v.yaml: ") or str(tmp_path) in str(error.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("double_bluey", "Did you mean 'double_blueye'?"),
        ("no/such.yaml", "no such file"),
        ("nothing_like_it_at_all", "Known: .*bluerov2_heavy.* double_blueye.* dvl_a50"),
    ],
)
def test_a_vehicle_that_is_not_there(name, message):
    with pytest.raises(ConfigError, match=message.replace("?", r"\?")):
        load_vehicle(name)


def test_a_vehicle_without_mass(tmp_path):
    (tmp_path / "v.yaml").write_text("name: v\ndescription: d\n")
    with pytest.raises(ConfigError, match="v.yaml: no part has a mass"):
        load_vehicle(tmp_path / "v.yaml").model()


def test_a_point_is_no_vehicle(tmp_path):
    (tmp_path / "v.yaml").write_text("name: v\ndescription: d\nmass: 1.0\n")
    with pytest.raises(ConfigError, match="give parts an inertia or a shape"):
        load_vehicle(tmp_path / "v.yaml").model()


def test_mistakes_in_a_part_file_name_that_file(tmp_path):
    (tmp_path / "pod.yaml").write_text("name: pod\ndescription: d\nmas: 1.0\n")
    (tmp_path / "v.yaml").write_text("name: v\ndescription: d\nmass: 1\nparts: [{name: p, part: pod}]\n")
    with pytest.raises(ConfigError, match="^pod.yaml: mas: no such key. Did you mean 'mass'"):
        load_vehicle(tmp_path / "v.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("PWM,Force\n1,2\n3,4\n5,6\n", "found columns pwm, force; expected also voltage"),
        ("PWM,Voltage,Force\n1100,16,-4\n1500,16,x\n1900,16,5\n", "line 3: found '1500,16,x', expected numbers"),
        ("PWM,Voltage,Force\n1500,16,0\n1100,16,-4\n1900,16,5\n", "PWM must increase"),
        ("PWM,Voltage,Force\n1200,16,-4\n1500,16,0\n1900,16,5\n", "PWM from 1200 to 1900, expected 1100 to 1900"),
        ("PWM,Voltage,Force\n1100,16,-4\n", "found 2 lines"),
        ("PWM,Voltage,Force\n1100,16," + "9" * 300_000 + "\n", "is no table of numbers"),
        ("PWM,Voltage,Force\n1100,16,-4\n1500,16,nan\n1900,16,5\n", "not finite"),
        ("PWM,Voltage,Force\n1100,0,-4\n1500,0,0\n1900,0,5\n", "found a voltage of 0 V, expected more than 0"),
    ],
)
def test_bad_thrust_tables(text, message, tmp_path):
    (tmp_path / "t.csv").write_text(text)
    data = GOOD | {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": "t.csv"}}]}
    (tmp_path / "v.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as error:
        load_vehicle(tmp_path / "v.yaml").model()
    assert message in str(error.value)
    assert str(error.value).startswith("v.yaml: thrusters[0].curve.table: ")


def test_two_tables_at_one_voltage(tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("PWM,Voltage,Force\n1100,16,-4\n1500,16,0\n1900,16,5\n")
    data = GOOD | {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": ["a.csv", "b.csv"]}}]}
    (tmp_path / "v.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError, match=r"thrusters\[0\].curve.table: b.csv: a second table at 16 V; keep one"):
        load_vehicle(tmp_path / "v.yaml")
