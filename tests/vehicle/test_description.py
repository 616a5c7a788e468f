"""Vehicle files: parts, poses, files in files, overrides, thrusters, cameras, and the model that comes out."""

import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax
from rovtwin.vehicle import check, list_library, load_vehicle, render, summary, vehicle_from_dict, vehicle_schema
from rovtwin.vehicle.physics.thrusters import command_for_force, static_force

GRAVITY = 9.81
force_of, command_of = jax.jit(static_force), jax.jit(command_for_force)
BALL = {"mass": 5.0, "shape": {"sphere": 0.1}}


def vehicle(**keys):
    return vehicle_from_dict({"name": "v", "description": "test", **keys})


def model(**keys):
    return vehicle(**keys).model()


def thruster(**keys):
    return {"name": "t", "direction": [1, 0, 0], "force": 10.0, **keys}


# --- parts and files


def test_part_files_are_found_beside_the_vehicle_then_in_the_library(tmp_path):
    (tmp_path / "ballast.yaml").write_text("name: ballast\ndescription: lead\nmass: 2.0\n")
    (tmp_path / "my.yaml").write_text(
        "name: my\ndescription: d\nparts:\n"
        "- {name: rov, part: blueye_pioneer}\n"
        "- {name: lead, part: ballast.yaml, pose: {position: [0, 0, 0.1]}}\n"
        "- {name: more, part: ballast, pose: {position: [0, 0, 0.2]}}\n"
    )
    found = load_vehicle(tmp_path / "my.yaml")
    assert found.assembly.solid.mass == pytest.approx(13.0)
    assert found.assembly.solid.center_of_gravity == pytest.approx([0, 0, 0.6 / 13])
    assert found.thruster_names == ["surge", "sway", "heave"]


def test_a_sensor_is_added_by_a_file_that_holds_the_vehicle():
    """Everything of the double_blueye stays, the DVL adds its own."""
    parts = [
        {"name": "rov", "part": "double_blueye"},
        {
            "name": "dvl",
            "mass": 0.2,
            "volume": 0.0001,
            "shape": {"cylinder": {"radius": 0.033, "length": 0.025}, "attitude_deg": [0, 90, 0]},
            "pose": {"position": [-0.2, 0, 0.16]},
            "sensors": [{"name": "dvl", "kind": "dvl"}],
        },
    ]
    bare, more = load_vehicle("double_blueye").assembly, vehicle(parts=parts).assembly
    assert more.solid.mass == pytest.approx(30.2)
    assert more.solid.inertia[1, 1] > bare.solid.inertia[1, 1]
    added = more.added_mass - bare.added_mass
    assert 0 < added[0, 0] < 0.2
    assert [s.name for s in more.sensors][-1] == "dvl.dvl"
    np.testing.assert_allclose(more.sensors[-1].position, [-0.2, 0, 0.16])
    # 0.2 kg less 0.1 kg of water.
    net = GRAVITY * (more.volume * more.density - more.solid.mass)
    assert net == pytest.approx(-0.1 * GRAVITY, rel=1e-9)


def test_a_vehicle_cannot_hold_itself(tmp_path):
    for a, b in (("one", "two"), ("two", "three"), ("three", "one")):
        (tmp_path / f"{a}.yaml").write_text(f"name: {a}\ndescription: d\nmass: 1\nparts: [{{name: p, part: {b}}}]\n")
    with pytest.raises(ConfigError, match="cannot be a part of itself: one.yaml -> two.yaml -> three.yaml -> one.yaml"):
        load_vehicle(tmp_path / "one.yaml")


def test_part_files_that_multiply_are_refused(tmp_path):
    """Each of 24 files names the next one twice: 17 million bodies."""
    for k in range(24):
        parts = "" if k == 23 else f"parts: [{{name: a, part: v{k + 1}.yaml}}, {{name: b, part: v{k + 1}.yaml}}]"
        (tmp_path / f"v{k}.yaml").write_text(f"name: v{k}\ndescription: d\nmass: 1\n{parts}\n")
    with pytest.raises(ConfigError, match="comes to 255 bodies with those of its part files, expected 200 at most"):
        load_vehicle(tmp_path / "v0.yaml")


def test_the_same_part_twice_is_no_cycle():
    assert vehicle(parts=[{"name": n, "part": "uhi"} for n in "ab"]).assembly.solid.mass == pytest.approx(8.0)


def test_devices_are_seen_from_the_outermost_body():
    """A camera looking along its part's x, on a part pitched nose down: it looks straight down."""
    inner = {"name": "head", "pose": {"position": [0.5, 0, 0], "attitude_deg": [0, -90, 0]}}
    inner["cameras"] = [{"name": "eye", "pose": {"position": [0.1, 0, 0]}}]
    outer = {"name": "arm", "pose": {"position": [0, 0, 0.2], "attitude_deg": [0, 0, 90]}, "parts": [inner]}
    camera = vehicle(parts=[outer], **BALL).cameras[0]
    assert camera.name == "arm.head.eye"
    # The arm points to starboard (y), the head hangs at its end and looks down (z).
    np.testing.assert_allclose(camera.position, [0, 0.5, 0.3], atol=1e-12)
    np.testing.assert_allclose(camera.rotation @ [1, 0, 0], [0, 0, 1], atol=1e-12)


def test_a_description_survives_as_data():
    for name in list_library():
        original = load_vehicle(name)
        data = json.loads(json.dumps(original.to_dict()))
        again = vehicle_from_dict(data)
        assert again.thruster_names == original.thruster_names
        for a, b in zip(again.assembly.damping().matrices(), original.assembly.damping().matrices(), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12)
        np.testing.assert_allclose(again.assembly.added_mass, original.assembly.added_mass, rtol=1e-12)
        assert again.to_dict() == data


# --- overrides


def test_null_leaves_a_direction_to_the_parts_and_a_number_replaces_it():
    shapes = {"parts": [{"name": "pod", "shape": {"sphere": 0.2}, "pose": {"position": [0.3, 0, 0]}}]}
    parts = vehicle(mass=5.0, inertia=[1, 1, 1], **shapes).assembly
    mixed = vehicle(
        mass=5.0,
        inertia=[1, 1, 1],
        hydrodynamics={"added_mass": [7.0, None, None, None, None, None], "quadratic_damping": [None] * 5 + [9.0]},
        **shapes,
    ).assembly
    assert mixed.added_mass[0, 0] == 7.0
    np.testing.assert_allclose(mixed.added_mass[1:, 1:], parts.added_mass[1:, 1:])
    # A pod ahead couples sway and yaw; what is given for yaw ends that coupling in damping.
    assert abs(parts.damping().quadratic_ahead[1, 5]) > 0.1
    assert mixed.damping().quadratic_ahead[1, 5] == 0.0
    assert mixed.damping().quadratic_astern[5, 5] == 9.0


def test_astern_is_as_ahead_unless_given():
    given = {"added_mass": [1] * 6, "linear_damping": [6.0, 3.0, 1, 1, 1, 1]}
    given["linear_damping_astern"] = [0.5, None, None, None, None, None]
    m = model(hydrodynamics=given, **BALL)
    assert m.linear_damping_ahead[0, 0] == 6.0
    assert m.linear_damping_astern[0, 0] == 0.5
    assert m.linear_damping_astern[1, 1] == 3.0


def test_full_matrices_are_taken_as_they_are():
    D = np.diag([10.0, 20, 20, 1, 1, 1])
    D[1, 5], D[5, 1] = 0.7, -0.2
    m = model(hydrodynamics={"linear_damping": D.tolist()}, **BALL)
    np.testing.assert_allclose(m.linear_damping_ahead, D)


@pytest.mark.parametrize(
    ("restoring", "buoyancy"),
    [
        ({"buoyancy": "neutral"}, 5 * GRAVITY),
        ({"net_buoyancy": 2.0}, 5 * GRAVITY + 2.0),
        ({"buoyancy": 60.0}, 60.0),
        ({}, 1000 * GRAVITY * 4 / 3 * math.pi * 0.001),
    ],
)
def test_buoyancy(restoring, buoyancy):
    assert float(model(restoring=restoring, **BALL).buoyancy) == pytest.approx(buoyancy)


def test_metacentric_height_puts_cb_above_cg():
    m = model(restoring={"metacentric_height": 0.03}, center_of_gravity=[0.01, 0, 0.02], **BALL)
    np.testing.assert_allclose(m.center_of_buoyancy, [0.01, 0, -0.01])


def test_options_of_model():
    found = load_vehicle("double_blueye")
    fresh, sea = found.model(), found.model(water_density=1025.0)
    np.testing.assert_allclose(sea.added_mass, 1.025 * fresh.added_mass)
    np.testing.assert_allclose(sea.quadratic_damping_astern, 1.025 * fresh.quadratic_damping_astern)
    np.testing.assert_allclose(sea.rigid_body_mass, fresh.rigid_body_mass)
    assert float(sea.buoyancy) == pytest.approx(1.025 * float(fresh.buoyancy))
    floating = found.model(net_buoyancy=2.0)
    assert float(floating.buoyancy - floating.weight) == pytest.approx(2.0)
    for options in ({"water_density": 1.025}, {"net_buoyancy": -400.0}, {"net_buoyancy": math.nan}):
        with pytest.raises(ConfigError, match="expected"):
            found.model(**options)


def test_density_at_which_a_part_was_measured():
    part = {"name": "p", "water_density": 1025.0, "hydrodynamics": {"added_mass": [10.25] * 6}, **BALL}
    assert vehicle(parts=[part]).assembly.added_mass[0, 0] == pytest.approx(10.0)


# --- thrusters


def test_directions_as_vector_and_as_angles():
    data = [
        thruster(name="a", direction=[0, 2, 0]),
        thruster(name="b", direction={"azimuth_deg": 90}),
        thruster(name="c", direction={"elevation_deg": 90}),
        thruster(name="d", direction={"azimuth_deg": -45, "elevation_deg": 30}),
    ]
    T = np.asarray(model(thrusters=data, **BALL).thrusters.configuration)
    c = math.cos(math.radians(30)) * math.sqrt(0.5)
    np.testing.assert_allclose(T[:3].T, [[0, 1, 0], [0, 1, 0], [0, 0, -1], [c, -c, -0.5]], atol=1e-12)


def test_moment_of_a_thruster_is_lever_cross_force():
    T = model(thrusters=[thruster(position=[0.1, 0.2, 0.3], direction=[0, 0, 1])], **BALL).thrusters.configuration
    np.testing.assert_allclose(T[:, 0], [0, 0, 1, 0.2, -0.1, 0])


def test_every_property_of_a_thruster_reaches_the_model():
    full = thruster(
        force={"ahead": 12.0, "astern": 7.0},
        curve={"power": 1.8},
        dead_band=0.05,
        time_constant=0.3,
        rate_limit=40.0,
        quantisation=0.01,
        health=0.5,
    )
    arrays = model(thrusters=[thruster(name="plain"), full], **BALL).thrusters
    expected = {
        "force_ahead": [10, 12],
        "force_astern": [10, 7],
        "exponent": [1, 1.8],
        "dead_band": [0, 0.05],
        "time_constant": [0, 0.3],
        "rate_limit": [np.inf, 40],
        "quantisation": [0, 0.01],
        "health": [1, 0.5],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(arrays, name), values)
    assert not np.asarray(arrays.tabulated).any()
    assert arrays.table_command.shape == (2,)


def test_tables_of_different_commands_share_one_grid_without_loss():
    one = thruster(name="one", curve={"table": [[-1, -4], [0, 0], [0.25, 1], [1, 8]]})
    two = thruster(name="two", curve={"table": [[-1, -3], [-0.1, 0], [0.1, 0], [1, 6]]})
    for t in (one, two):
        del t["force"]
    arrays = model(thrusters=[one, thruster(name="line"), two], **BALL).thrusters
    for u, forces in [(0.25, [1.0, 2.5, 1.0]), (0.625, [4.5, 6.25, 3.5]), (-0.55, [-2.2, -5.5, -1.5])]:
        np.testing.assert_allclose(force_of(arrays, np.full(3, u)), forces, atol=1e-12)
    np.testing.assert_allclose(arrays.force_ahead, [8, 10, 6])
    np.testing.assert_allclose(arrays.force_astern, [4, 10, 3])
    expected = np.array([5.0, -4.0, 2.0])
    np.testing.assert_allclose(force_of(arrays, command_of(arrays, expected)), expected, atol=1e-9)


def test_voltage_is_interpolated_between_tables():
    curve = {"table": {"12": [[-1, -2], [0, 0], [1, 4]], "16": [[-1, -4], [0, 0], [0.5, 3], [1, 8]]}}
    data = thruster(curve=curve)
    del data["force"]
    found = vehicle(thrusters=[data], supply_voltage=16, **BALL)
    full = np.ones(1)
    assert float(force_of(found.model().thrusters, full)[0]) == 8.0
    assert float(force_of(found.model(supply_voltage=13).thrusters, full)[0]) == pytest.approx(5.0)
    with pytest.raises(ConfigError, match="supply voltage 18 V, but the tables hold from 12 to 16 V"):
        found.model(supply_voltage=18)
    with pytest.raises(ConfigError, match="tables for 12, 16 V, but no supply voltage; write 'supply_voltage: 12'"):
        vehicle(thrusters=[data], **BALL).model()


TESTED = {"12": [[-1, -2], [0, 0], [1, 4]], "16": [[-1, -4], [0, 0], [0.5, 3], [1, 8]]}
POD = {"thrusters": [{"name": "t", "direction": [1, 0, 0], "curve": {"table": TESTED}}]}


def test_the_nearest_part_that_gives_a_voltage_wins():
    inner = {"name": "inner", **POD}
    parts = [
        {"name": "a", "supply_voltage": 12, **POD},
        {"name": "b", **POD},
        {"name": "c", "supply_voltage": 13, "parts": [inner, {"name": "own", "supply_voltage": 14, **POD}]},
    ]

    def forces(voltage=None, **keys):
        found = vehicle(parts=parts, **BALL, **keys)
        assert found.thruster_names == ["a.t", "b.t", "c.inner.t", "c.own.t"]
        return np.asarray(found.model(supply_voltage=voltage).thrusters.force_ahead)

    np.testing.assert_allclose(forces(supply_voltage=16), [4, 8, 5, 6])
    np.testing.assert_allclose(forces(supply_voltage=16, voltage=15), [7, 7, 7, 7])
    with pytest.raises(ConfigError, match="thruster 'b.t': tables for 12, 16 V, but no supply voltage"):
        forces()
    alone = model(parts=[{"name": "a", "supply_voltage": 12, **POD}], **BALL)
    np.testing.assert_allclose(alone.thrusters.force_ahead, [4.0])


def test_a_voltage_in_a_part_file_stays_with_the_part(tmp_path):
    (tmp_path / "pod.yaml").write_text(json.dumps({"name": "pod", "description": "d", "supply_voltage": 12, **POD}))
    data = {"name": "v", "description": "d", "supply_voltage": 16, "parts": [{"name": "p", "part": "pod.yaml"}], **BALL}
    found = vehicle_from_dict(data, folder=tmp_path)
    for one in (found, vehicle_from_dict(found.to_dict())):
        np.testing.assert_allclose(one.model().thrusters.force_ahead, [4.0])


def test_a_vehicle_written_out_needs_no_file(tmp_path):
    """Tables of a part in another folder are in the dump as points, exactly."""
    folder = tmp_path / "lab" / "tests"
    folder.mkdir(parents=True)
    # Wider than full command: the points at +-1 lie between those of the test.
    for volts, ahead in ((12.03, 2.9), (15.98, 5.1)):
        rows = [(1080, -1.05 * ahead), (1200, -0.61 * ahead), (1500, 0), (1700, 0.37 * ahead), (1920, 1.05 * ahead)]
        lines = [f"{pwm},{volts},{force}" for pwm, force in rows]
        (folder / f"{volts}.csv").write_text("\n".join(["PWM,Voltage,Force", *lines]))
    tables = ["tests/15.98.csv", "tests/12.03.csv"]
    thrusters = [{"name": n, "direction": [1, 0, 0], "curve": {"table": t}} for n, t in (("a", tables), ("b", tables))]
    pod = {"name": "pod", "description": "d", "supply_voltage": 14, "thrusters": thrusters}
    (tmp_path / "lab" / "pod.yaml").write_text(json.dumps(pod))
    whole = {"name": "v", "description": "d", "parts": [{"name": "p", "part": "lab/pod.yaml"}], **BALL}
    (tmp_path / "v.yaml").write_text(json.dumps(whole))
    found = load_vehicle(tmp_path / "v.yaml")
    before = found.model()
    dump = json.loads(json.dumps(found.to_dict()))
    for file in folder.iterdir():
        file.unlink()
    after = vehicle_from_dict(dump).model()
    for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        np.testing.assert_array_equal(a, b)
    assert ".csv" not in json.dumps(dump)
    end = np.interp((14 - 12.03) / (15.98 - 12.03), [0, 1], [2.9, 5.1]) * 9.80665
    at_full = 0.37 + (1.05 - 0.37) * 200 / 220
    np.testing.assert_allclose(before.thrusters.force_ahead, [end * at_full] * 2, rtol=1e-12)


# --- schema, summary, findings


def accepts(schema, value, root):
    """The part of JSON Schema that pydantic writes; raises AssertionError where the value does not fit."""
    if "$ref" in schema:
        return accepts(root["$defs"][schema["$ref"].rsplit("/", 1)[1]], value, root)
    if "anyOf" in schema:
        return any(accepts(branch, value, root) for branch in schema["anyOf"])
    if "const" in schema or "enum" in schema:
        return value in schema.get("enum", [schema.get("const")])
    kinds = {
        "object": dict,
        "array": list,
        "string": str,
        "number": (int, float),
        "integer": int,
        "null": type(None),
        "boolean": bool,
    }
    if "type" in schema and not isinstance(value, kinds[schema["type"]]):
        return False
    if isinstance(value, dict):
        properties, extra = schema.get("properties", {}), schema.get("additionalProperties", True)
        if any(key not in value for key in schema.get("required", [])):
            return False
        for key, inner in value.items():
            rule = properties.get(key, extra)
            if rule is False or (isinstance(rule, dict) and not accepts(rule, inner, root)):
                return False
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", math.inf):
            return False
        return all(accepts(schema.get("items", {}), item, root) for item in value)
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        above = value >= schema.get("minimum", -math.inf) and value > schema.get("exclusiveMinimum", -math.inf)
        return above and value <= schema.get("maximum", math.inf) and value < schema.get("exclusiveMaximum", math.inf)
    return True


@pytest.mark.parametrize("name", list_library())
def test_the_json_schema_accepts_the_library(name):
    from rovtwin.core.user_files.config import read_yaml
    from rovtwin.vehicle.description.files import LIBRARY

    schema = vehicle_schema()
    data = read_yaml(LIBRARY / f"{name}.yaml")
    assert accepts(schema, data, schema)
    assert not accepts(schema, data | {"wings": 2}, schema)
    assert not accepts(schema, data | {"mass": -1}, schema)


def test_the_json_schema_explains_itself():
    schema = vehicle_schema()
    assert json.dumps(schema)
    part = schema["$defs"]["Part"]["properties"]
    assert "description" in part["mass"]
    assert "kg" in part["mass"]["description"]


def test_summary_is_plain_data_and_says_what_matters():
    found = json.loads(json.dumps(summary(load_vehicle("double_blueye")), allow_nan=False))
    assert found["mass_kg"] == pytest.approx(30.0)
    assert found["allocation"]["rank"] == 5
    assert found["allocation"]["uncontrollable"] == ["pitch (M)"]
    symbols = {d["symbol"]: d for d in found["derivatives"]}
    assert symbols["X_u"]["value"] == pytest.approx(-6.48)
    assert symbols["X_u astern"]["value"] == pytest.approx(-0.07)
    assert "Y_v astern" not in symbols
    assert symbols["N_rdot"]["unit"] == "kg m2"
    assert found["thrusters"][3]["name"] == "starboard.surge"
    assert found["thrusters"][3]["position_m"] == [0, 0.28, 0]
    assert found["natural_periods_s"]["heave"] is None


def test_render_prints_every_name():
    from rich.console import Console

    from rovtwin.vehicle import render

    out = Console(width=150, record=True, file=io.StringIO())
    for item in render(summary(load_vehicle("double_blueye"))):
        out.print(item)
    text = out.export_text()
    for word in ("starboard.heave", "pitch (M)", "Z_wdot", "metacentric height BG", "[0, -0.28, 0]", "thesis (3.2)"):
        assert word in text


@pytest.mark.parametrize("name", ["double_blueye", "bluerov2_heavy"])
def test_tables_break_no_word_at_80_columns(name):
    from rich.console import Console

    from rovtwin.vehicle import render

    def printed(found, width):
        out = Console(width=width, record=True, file=io.StringIO())
        for item in render(found):
            out.print(item)
        return re.sub("[─│╭╮╰╯]", " ", out.export_text())

    vehicle_itself = load_vehicle(name)
    found = summary(vehicle_itself)
    narrow = printed(found, 80)
    assert max(len(line) for line in narrow.splitlines()) <= 80
    assert sorted(narrow.split()) == sorted(printed(found, 400).split())
    for column, thruster_name in enumerate(vehicle_itself.thruster_names):
        number = str(column + 1)
        rows = [line.split() for line in narrow.splitlines() if line.split()[:1] == [number]]
        assert len(rows) == 3 and rows[0][1] == thruster_name
        T = np.array(found["allocation"]["matrix"])[:, column]
        np.testing.assert_allclose([float(cell) for cell in rows[2][1:]], T, rtol=1e-3)


def test_a_name_wider_than_the_terminal_is_folded_and_not_cut():
    from rich.console import Console

    from rovtwin.vehicle import render

    name = "a" * 90
    out = Console(width=80, record=True, file=io.StringIO())
    for item in render(summary(vehicle(thrusters=[thruster(name=name)], **BALL))):
        out.print(item)
    assert out.export_text().count("a" * 9) >= 9
    assert "…" not in out.export_text()


def test_uncontrollable_directions_that_are_no_axis():
    """One thruster ahead and one to starboard, both above CO: pitch comes with surge, roll with sway."""
    data = [
        thruster(name="x", position=[0, 0, -0.1]),
        thruster(name="y", position=[0, 0, -0.1], direction=[0, 1, 0]),
    ]
    found = summary(vehicle(thrusters=data, **BALL))["allocation"]
    assert found["rank"] == 2
    # The moments come with the forces, M = -0.1 X and K = 0.1 Y: these combinations stay zero.
    assert found["uncontrollable"] == [
        "pitch (M) by itself, only M = -0.1 X",
        "roll (K) by itself, only K = 0.1 Y",
        "heave (Z)",
        "yaw (N)",
    ]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"thrusters": []}, "no thrusters"),
        ({"thrusters": [thruster()]}, "allocation has rank 1 of 6: no thruster reaches"),
        ({"thrusters": [thruster(direction=[1, 1, 0])]}, "is not a unit vector and was normalised"),
        ({"thrusters": [thruster(health=0.4)]}, "has 40 % of its force left"),
        ({"restoring": {"net_buoyancy": 3.0}}, "floats with 3 N"),
        ({"restoring": {"net_buoyancy": -3.0}}, "sinks with 3 N"),
        ({"center_of_gravity": [0, 0, -0.02]}, "roll has no righting moment"),
        ({"center_of_gravity": [0.01, 0, 0.02]}, "pitch trim"),
        ({"parts": [{"name": "lead", "mass": 1.0}]}, "v.lead: 1 kg counted as a point"),
        (
            {"restoring": {"net_buoyancy": 30.0}, "thrusters": [thruster(direction=[0, 0, 1])]},
            "floats with 30 N, more than the thrusters have;",
        ),
        ({"mass": 9.0}, "weigh 9 kg: is a volume missing?"),
        ({"mass": 1.0}, "weigh 1 kg: is a mass missing, or a volume in litres?"),
        (
            {"shape": {"box": [400, 300, 220]}, "volume": 0.0095, "mass": 9.6},
            "m3 and its volume is 0.0095: is the shape in millimetres?",
        ),
        (
            {"parts": [{"name": "a", "shape": {"sphere": 100}, "mass": 4.0}]},
            "kg of water and its mass is 4: is the shape in millimetres?",
        ),
        ({"volume": 4.19}, "its volume is 4.19: is the volume in litres?"),
        ({"mass": 4190.0}, "its mass is 4190: is the mass in grams?"),
        ({"thrusters": [thruster(position=[240, -170, 20])]}, "thruster 't' is 295 m from CG"),
        ({"center_of_buoyancy": [0, -20, -40]}, "CB is 44.7 m from CG"),
        ({"shape": None, "inertia": [0.1] * 3, "thrusters": [thruster(position=[90, 0, 0])]}, "is 90 m from CG"),
        ({"inertia": [330, 600, 750]}, "radius of gyration about x is 8.12 m: are inertia and places in kg m2 and m?"),
        ({"thrusters": [thruster(time_constant=120)]}, "takes 120 s to follow its command: is its time_constant in"),
        (
            {
                "thrusters": [
                    thruster(name=f"y{a}", position=[x, y, 0], direction={"azimuth_deg": a}, force=20.0)
                    for a, x, y in ((0, 0.0, -0.2), (120, 0.173, 0.1), (240, -0.173, 0.1))
                ]
            },
            "N in surge 30 N neither turn the vehicle nor push it another way",
        ),
        (
            {
                "thrusters": [
                    thruster(name=f"h{a % 360}", position=[x, y, 0], direction={"azimuth_deg": a})
                    for a, x, y in ((35, -0.14, -0.1), (-35, -0.14, 0.1), (-36, 0.14, -0.1), (36, 0.14, 0.1))
                ]
            },
            "4 horizontal thrusters make 0.06 N m in yaw, for they push nearly through CG: have their azimuths",
        ),
        (
            {
                "restoring": {"net_buoyancy": 0.0, "metacentric_height": 0.02},
                "thrusters": [thruster(direction=[0, 0, 1], position=[-0.05, 0, 0])],
            },
            "full thrust in heave pitches it by 27 deg: it acts 50 mm behind CG, and no other thrusters balance it",
        ),
        (
            {
                "restoring": {"net_buoyancy": 0.0, "metacentric_height": 0.02},
                "thrusters": [thruster(position=[0, 0, -0.04])],
            },
            "it acts 40 mm above CG, and no other thrusters balance it",
        ),
        (
            {
                "restoring": {"net_buoyancy": 0.0, "metacentric_height": 0.02},
                "thrusters": [thruster(direction=[0, 1, 0], position=[0, 0, 0.04])],
            },
            "deg: it acts 40 mm below CG,",
        ),
        (
            {
                "restoring": {"net_buoyancy": 0.0, "metacentric_height": 0.02},
                "thrusters": [thruster(direction=[0, 0, 1], position=[0, -0.05, 0])],
            },
            "it acts 50 mm to port of CG,",
        ),
        ({}, "their interaction is not in it"),
        ({"hydrodynamics": {"linear_damping": [0] * 6, "quadratic_damping": [0] * 6}}, "sway has no damping at all"),
    ],
)
def test_findings(keys, message, tmp_path):
    import yaml

    path = tmp_path / "v.yaml"
    path.write_text(yaml.safe_dump({"name": "v", "description": "d", **BALL, **keys}))
    assert any(message in line for line in check(path).findings), check(path)


@pytest.mark.parametrize(
    ("keys", "verdict"),
    [
        ({"restoring": {"net_buoyancy": 3.0, "metacentric_height": 0.02}}, "usable"),
        ({"restoring": {"net_buoyancy": -3.0, "metacentric_height": 0.02}}, "usable, but: it sinks with 3 N"),
        (
            {"restoring": {"net_buoyancy": -13.0, "metacentric_height": 0.02}},
            "usable, but: it sinks with 13 N, and its thrusters lift 8 N",
        ),
        (
            {"restoring": {"net_buoyancy": 11.0, "metacentric_height": 0.02}},
            "usable, but: it floats with 11 N, and its thrusters push down 10 N",
        ),
        (
            {"restoring": {"buoyancy": "neutral", "metacentric_height": -0.02}},
            "usable, but: it capsizes: CG is above CB",
        ),
        ({"restoring": {"buoyancy": "neutral"}}, "usable, but: nothing rights it: CG is at CB"),
        (
            {"restoring": {"buoyancy": "neutral", "center_of_buoyancy": [0.02, 0, -0.02]}},
            "usable, but: it hangs at roll 0, pitch 45 deg",
        ),
        (
            {"restoring": {"net_buoyancy": -1.0, "metacentric_height": -0.02}, "thrusters": []},
            "usable, but: it sinks with 1 N; it capsizes: CG is above CB; it has no thrusters",
        ),
    ],
)
def test_verdict(keys, verdict, tmp_path):
    import yaml

    path = tmp_path / "v.yaml"
    heave = thruster(direction=[0, 0, 1], force={"ahead": 10.0, "astern": 8.0})
    path.write_text(yaml.safe_dump({"name": "v", "description": "d", "thrusters": [heave], **BALL, **keys}))
    assert check(path).verdict == verdict


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"thrusters": [thruster(position=[240, -170, 20])]}, "units look wrong (thruster 't')"),
        ({"parts": [{"name": "a", "shape": {"sphere": 100}, "mass": 4.0}]}, "units look wrong (v.a)"),
        ({"thrusters": [thruster(time_constant=120)]}, "units look wrong (thruster 't')"),
    ],
)
def test_the_verdict_names_what_the_lines_below_doubt(keys, named, tmp_path):
    found = checked(keys, tmp_path)
    assert named in found.reservations and "is " in "".join(found.findings)


def four(*angles):
    """Four horizontal thrusters at azimuths given in the file as they stand."""
    at = [(0.2, -0.2), (0.2, 0.2), (-0.2, -0.2), (-0.2, 0.2)]
    return [
        thruster(name=f"t{i}", position=[x, y, 0], direction={"azimuth_deg": angle})
        for i, ((x, y), angle) in enumerate(zip(at, angles, strict=True))
    ]


@pytest.mark.parametrize(
    ("thrusters", "message"),
    [
        (four(0.611, -0.611, -0.611, 0.611), "v: the angles of its thrusters, 0.611 deg, look like radians: 35 deg?"),
        (four(0.785, -0.785, 2.356, -2.356), "0.785, 2.356 deg, look like radians: 45, 135 deg?"),
        (four(1.57, -1.57, 0, 0), "1.57 deg, look like radians: 90 deg?"),
        (four(1, -1, -1, 1), "make 0.7 N in sway, 1.7 % of those in surge: are their directions right"),
    ],
)
def test_angles_in_radians_are_seen(thrusters, message, tmp_path):
    found = checked({"thrusters": thrusters}, tmp_path)
    assert any(message in line for line in found.findings), found
    assert "units look wrong (angles of thrusters)" in found.reservations


@pytest.mark.parametrize("angles", [(35, -35, -35, 35), (3, -3, -3, 3), (0, 0, 0, 0), (4.5, -4.5, 2.25, -2.25)])
def test_angles_in_degrees_are_not_doubted(angles, tmp_path):
    found = checked({"thrusters": four(*angles)}, tmp_path)
    assert not any("radians" in line or "in degrees" in line for line in found.findings), found


def checked(keys, tmp_path):
    import yaml

    path = tmp_path / "v.yaml"
    path.write_text(yaml.safe_dump({"name": "v", "description": "d", **BALL, **keys}))
    return check(path)


def test_verdicts_on_the_library():
    text = {
        name: check(name).verdict for name in ("double_blueye", "double_blueye_thesis", "bluerov2", "bluerov2_heavy")
    }
    # Its published weight and buoyancy are 1 N apart.
    assert text.pop("bluerov2_heavy") == "usable, but: it sinks with 0.981 N"
    assert set(text.values()) == {"usable"}


def test_the_example_of_the_docs_loads(tmp_path):
    """docs/vehicles.md: the vehicle with a DVL, as one would save it."""
    text = (Path(__file__).parents[2] / "docs" / "vehicles.md").read_text(encoding="utf-8")
    path = tmp_path / "my.yaml"
    path.write_text(text.split("```yaml\n")[1].split("```")[0])
    found = load_vehicle(path)
    assert found.assembly.solid.mass == pytest.approx(30.17)
    assert float(found.model().buoyancy - found.model().weight) == pytest.approx(2.0)
    np.testing.assert_allclose(found.sensors[-1].position, [-0.2, 0, 0.16])


def test_tethers_sit_in_their_parts_and_are_shown():
    vehicle = load_vehicle("double_blueye")
    assert [t.name for t in vehicle.tethers] == ["port.tether", "starboard.tether"]
    found = summary(vehicle)["tethers"]
    assert [t["position_m"] for t in found] == [[-0.22, -0.28, 0.0], [-0.22, 0.28, 0.0]]
    assert found[0]["diameter_m"] == 0.005 and found[0]["length_m"] == 150.0
    assert found[0]["wet_weight_N_per_m"] == 0.0


def test_batteries_are_shown_with_what_they_feed():
    from rich.console import Console

    found = summary(load_vehicle("double_blueye"))
    assert found["batteries"][0] == {
        "name": "port",
        "capacity_Wh": 75.0,
        "hotel_load_W": 20.0,
        "thrusters": ["port.surge", "port.sway", "port.heave"],
    }
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(*render(found))
    assert "starboard.heave" in console.export_text().split("batteries", 1)[1].split("where the values", 1)[0]


@pytest.mark.parametrize(
    ("tether", "expected"),
    [
        ({"name": "tether", "diameter": 0.005}, "tethers[0].length: missing (on the drum"),
        (
            {"name": "tether", "diameter": 5.0, "length": 50.0},
            "tethers[0].diameter: found 5.0, expected a number",
        ),
        ({"name": "the tether", "diameter": 0.005, "length": 50.0}, "tethers[0].name: found 'the tether'"),
    ],
)
def test_no_tether_like_that(tether, expected):
    with pytest.raises(ConfigError) as error:
        vehicle_from_dict({"name": "x", "mass": 1.0, "shape": {"sphere": 0.1}, "tethers": [tether]})
    assert expected in str(error.value)
