"""Programs kept between processes: what a key is made of, and what becomes of files that are not as they were written.

What is kept is of this package alone, so that these tests borrow modules of it and change them.
"""

import collections
import os
import pickle
import types

import equinox as eqx
import numpy as np
import pytest
from jax._src import config

from rovtwin.core import numerics
from rovtwin.core.arrays import small_matrices
from rovtwin.core.arrays.flat import Flat, Layout
from rovtwin.core.block import Start
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.programs import kept, values
from rovtwin.core.programs.compiled import Compiled, in_one_piece, jit_once, shapes_in_one_piece
from rovtwin.core.programs.description import Description, Undescribed
from rovtwin.gnc.safety.rules import Rules
from rovtwin.runs.loop import Loop
from rovtwin.simulation.environment.current import ConstantCurrent
from rovtwin.vehicle.physics.actuation import wrench_limits

summed_product = small_matrices.summed_product
ROWS = ("limit", "after", "action", "fence", "allowance", "nearer", "step")
MATRIX = jnp.arange(9.0).reshape(3, 3)


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """An empty one, of this test alone."""
    monkeypatch.setenv("ROVTWIN_CACHE", str(tmp_path))
    return tmp_path / "programs"


@pytest.fixture
def traces(monkeypatch):
    """How often a function was traced to be compiled."""
    found = []
    compile_ = Compiled._compile
    monkeypatch.setattr(Compiled, "_compile", lambda self, *given: found.append(1) or compile_(self, *given))
    monkeypatch.setattr(kept, "key_of", keyed(kept.key_of))
    return found


def keyed(key_of):
    """Keys as they would be if the class that counts had not been changed for a test."""
    return lambda self, *given: key_of(self._function, *given)


def digest(*given):
    description = Description()
    for one in given:
        description.put(one)
    return description.digest()


def fresh(name="summed_product"):
    """The same function as another process has it: no program of it is known yet."""
    jax.clear_caches()
    return jit_once(getattr(small_matrices, name))


def test_a_program_that_was_kept_is_taken_without_a_trace(folder, traces):
    first = fresh()(MATRIX, MATRIX)
    assert len(traces) == 1 and [file.name.split("-")[0] for file in folder.iterdir()] == ["summed_product"]
    again = fresh()(MATRIX, MATRIX)
    assert len(traces) == 1
    np.testing.assert_array_equal(again, first)
    np.testing.assert_array_equal(first, MATRIX @ MATRIX)


def test_a_program_read_from_the_cache_of_jax_is_kept_whole(folder, traces):
    """What XLA has read it does not write whole: it lacks functions."""
    first = fresh()(MATRIX, MATRIX)
    for file in folder.iterdir():
        file.unlink()
    fresh()(MATRIX, MATRIX)  # compiled by way of JAX's cache
    assert len(traces) == 2 and len(list(folder.iterdir())) == 1
    np.testing.assert_array_equal(fresh()(MATRIX, MATRIX), first)
    assert len(traces) == 2


def test_other_shapes_types_and_static_arguments_are_other_programs():
    keys = [
        kept.key_of(summed_product, (MATRIX, MATRIX)),
        kept.key_of(summed_product, (MATRIX[:2], MATRIX)),
        kept.key_of(summed_product, (MATRIX.astype(jnp.float32), MATRIX)),
        kept.key_of(summed_product, ((MATRIX, MATRIX),)),
        kept.key_of(summed_product, ({"a": MATRIX}, MATRIX)),
        kept.key_of(summed_product, ({"b": MATRIX}, MATRIX)),
        kept.key_of(summed_product, (1.0, MATRIX)),
        kept.key_of(summed_product, (1, MATRIX)),
        kept.key_of(summed_product, (MATRIX, MATRIX), {"dt": 0.02}),
        kept.key_of(summed_product, (MATRIX, MATRIX), {"dt": np.nextafter(0.02, 1.0)}),
        kept.key_of(summed_product, (MATRIX, MATRIX), {"dt": 1}),
        kept.key_of(summed_product, (MATRIX, MATRIX), {"dt": True}),
        kept.key_of(summed_product, (MATRIX, MATRIX), {"dt": "1"}),
        kept.key_of(wrench_limits, (MATRIX, MATRIX)),
    ]
    assert None not in keys and len(set(keys)) == len(keys)
    assert kept.key_of(summed_product, (MATRIX + 1.0, MATRIX)) == keys[0]  # values do not belong to a program


def test_static_fields_belong_to_the_key_and_values_do_not():
    one = ConstantCurrent(as_array([0.1, 0.0, 0.0]))
    assert kept.key_of(summed_product, (one,)) == kept.key_of(
        summed_product, (ConstantCurrent(as_array([0.2, 0.0, 0.0])),)
    )
    assert digest(Loop) != digest(Start)
    other = eqx.tree_at(lambda current: current.velocity, one, None)
    assert kept.key_of(summed_product, (other,)) not in (kept.key_of(summed_product, (one,)), None)
    rows = [Rules(**dict.fromkeys(ROWS, as_array(1.0)), sensors=sensors) for sensors in (("dvl",), ("gyro",))]
    assert len({kept.key_of(summed_product, (row,)) for row in rows} - {None}) == 2


@pytest.mark.parametrize(
    "change",
    ["code", "default", "constant", "dictionary", "array", "class", "another module", "wrapped"],
)
def test_code_and_constants_that_changed_in_this_process_are_another_key(change, monkeypatch):
    """As if a file had been edited, or a constant set from outside."""
    function = types.FunctionType(summed_product.__code__, small_matrices.__dict__, "summed_product")
    monkeypatch.setattr(small_matrices, "EXAMPLE", {"a": [1, 2.0]}, raising=False)
    monkeypatch.setattr(small_matrices, "TABLE", np.arange(3.0), raising=False)
    monkeypatch.setattr(small_matrices, "borrowed", ConstantCurrent, raising=False)
    before = kept.key_of(summed_product, (MATRIX, MATRIX))
    assert before is not None and before == kept.key_of(summed_product, (MATRIX, MATRIX))
    match change:
        case "code":
            other = compile("def f(A, B):\n    return A + B\n", "x", "exec").co_consts[0]
            monkeypatch.setattr(summed_product, "__code__", other)
        case "default":
            monkeypatch.setattr(summed_product, "__defaults__", (1,))
        case "constant":
            monkeypatch.setattr(small_matrices, "EXAMPLE", 3)
        case "dictionary":
            vars(small_matrices)["EXAMPLE"]["a"][1] = 2.5
        case "array":
            vars(small_matrices)["TABLE"][1] += 1e-15
        case "class":
            monkeypatch.setattr(ConstantCurrent, "init", ConstantCurrent.step)
        case "another module":
            monkeypatch.setattr("rovtwin.simulation.environment.current.jnp", np)
        case "wrapped":
            monkeypatch.setattr(small_matrices, "summed_product", jax.jit(function))
    assert kept.key_of(summed_product, (MATRIX, MATRIX)) != before


def test_versions_flags_processor_and_settings_belong_to_the_key(monkeypatch):
    def key():
        kept._surroundings.cache_clear()
        return kept.key_of(summed_product, (MATRIX, MATRIX))

    keys = [key()]
    with jax.default_matmul_precision("float32"):
        keys.append(key())
    with jax.enable_x64(False):
        keys.append(key())
    jax.config.update("jax_disable_most_optimizations", not jax.config.read("jax_disable_most_optimizations"))
    keys.append(key())
    jax.config.update("jax_disable_most_optimizations", not jax.config.read("jax_disable_most_optimizations"))
    for what, value in (
        ("rovtwin.core.programs.kept._processor", lambda: "another"),
        ("rovtwin.core.programs.kept._version", lambda library: "another"),
        ("rovtwin.core.programs.kept._own_files", lambda: (("core/numerics.py", 1, 2),)),
        ("rovtwin.core.programs.kept.FORMAT", b"another"),
        ("sys.version", "another"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(what, value)
            keys.append(key())
    with monkeypatch.context() as patch:
        patch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", "") + " --xla_cpu_enable_fast_math=true")
        keys.append(key())
    kept._surroundings.cache_clear()
    assert len({*keys}) == len(keys) and key() == keys[0]


def test_nothing_is_kept_of_code_that_is_not_of_this_package(folder):
    class Own(eqx.Module):
        gain: jax.Array

    def own(x):
        return 2.0 * x

    for function, arguments in ((own, (MATRIX,)), (summed_product, (Own(MATRIX), MATRIX)), (lambda x: x, (MATRIX,))):
        assert kept.key_of(function, arguments) is None
    assert kept.key_of(summed_product, (MATRIX, MATRIX), {"own": Own(MATRIX)}) is None
    np.testing.assert_array_equal(jit_once(own)(MATRIX), 2.0 * MATRIX)
    assert not folder.exists()


def test_nothing_is_kept_where_code_of_others_was_put_into_this_package(monkeypatch):
    monkeypatch.setattr(small_matrices, "jnp", types.SimpleNamespace())
    assert kept.key_of(summed_product, (MATRIX, MATRIX)) is None
    monkeypatch.setattr(small_matrices, "jnp", jnp)
    monkeypatch.setattr(small_matrices, "summed_product", lambda a, b: a)
    assert kept.key_of(summed_product, (MATRIX, MATRIX)) is None


def test_what_has_no_description_has_no_key():
    for value in (iter([1]), {1: iter([1])}, {(1, 2): {object()}}, jax.random.key(0), types.SimpleNamespace()):
        with pytest.raises(Undescribed):
            digest(value)
    assert kept.key_of(summed_product, (MATRIX, MATRIX), iter([1])) is None


@pytest.mark.parametrize("damage", ["empty", "half", "bit", "of another version", "of another key", "another pickle"])
def test_a_damaged_file_is_compiled_anew_with_one_remark(damage, folder, traces, caplog):
    expected = fresh()(MATRIX, MATRIX)
    file = next(folder.iterdir())
    whole = file.read_bytes()
    match damage:
        case "empty":
            file.write_bytes(b"")
        case "half":
            file.write_bytes(whole[: len(whole) // 2])
        case "bit":
            file.write_bytes(whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:])
        case "of another version":
            file.write_bytes(whole.replace(kept.FORMAT, b"rovtwin program 0\n"))
        case "of another key":
            key = file.name.split("-")[1]
            file.write_bytes(whole.replace(key.encode(), key[::-1].encode()))
        case "another pickle":
            name, key = file.name.split("-")
            kept.write(name, key, ("source", b"no program", None))
    with caplog.at_level("WARNING", "rovtwin"):
        np.testing.assert_array_equal(fresh()(MATRIX, MATRIX), expected)
    assert len(caplog.records) == 1 and file.name in caplog.text and "made anew" in caplog.text
    assert len(traces) == 2
    caplog.clear()
    np.testing.assert_array_equal(fresh()(MATRIX, MATRIX), expected)  # it was written anew
    assert len(traces) == 2 and not caplog.records


def test_a_folder_that_cannot_be_written_is_no_error(monkeypatch, tmp_path, traces):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ROVTWIN_CACHE", str(tmp_path / "file"))
    np.testing.assert_array_equal(fresh()(MATRIX, MATRIX), MATRIX @ MATRIX)
    assert len(traces) == 1


def test_the_check_finds_a_program_under_the_key_of_another(folder, monkeypatch):
    """The audit must be able to fail: a wrong program is put where the right one belongs."""
    monkeypatch.setenv("ROVTWIN_CHECK_KEPT", "1")
    fresh()(MATRIX, MATRIX)
    fresh()(MATRIX, MATRIX)  # the right one passes
    file = next(folder.iterdir())
    name, key = file.name.split("-")
    source, executable, gives = kept.read(name, key)
    kept.write(name, key, (source[::-1], executable, gives))
    with pytest.raises(kept.WrongProgram, match="another program"):
        fresh()(MATRIX, MATRIX)


def test_nothing_is_kept_while_the_cache_of_jax_is_off(folder):
    before = config.enable_compilation_cache.value
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        fresh()(MATRIX, MATRIX)
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
    assert not folder.exists()


def test_a_compiled_function_may_be_called_in_another(folder):
    whole = in_one_piece(small_matrices.summed_product)
    np.testing.assert_array_equal(jax.jit(whole)(MATRIX, MATRIX), MATRIX @ MATRIX)
    np.testing.assert_allclose(jax.vmap(whole)(MATRIX[None], MATRIX[None])[0], MATRIX @ MATRIX)


def test_a_flat_tree_says_what_lies_where_and_survives_a_pickle():
    tree = {"start": Start.at((1.0, 2.0, 3.0)), "n": jnp.arange(2), "on": jnp.asarray(True)}
    flat = jax.jit(Flat.of)(tree)
    assert flat.layout == Layout(tree) and hash(flat.layout) == hash(Layout(tree))
    for one, other in zip(jax.tree.leaves(flat.tree), jax.tree.leaves(tree), strict=True):
        np.testing.assert_array_equal(one, other)
    again = pickle.loads(kept._pickled(flat.layout))
    assert again == flat.layout and hash(again) == hash(flat.layout)
    assert digest(again) == digest(flat.layout) != digest(Layout({"n": jnp.arange(2)}))


def test_a_value_is_computed_once_for_equal_arguments(folder, monkeypatch):
    def count(thrusters):
        raise AssertionError("computed again")

    function = values.once_and_for_all(small_matrices.summed_product)
    first = function(MATRIX, MATRIX)
    assert function(MATRIX, MATRIX) is first and len(list(folder.iterdir())) == 1
    again = values.once_and_for_all(small_matrices.summed_product)  # as another process has it
    again._function = function._function
    np.testing.assert_array_equal(again(MATRIX, MATRIX), first)
    function(MATRIX + 1e-12, MATRIX)
    assert len(list(folder.iterdir())) == 2
    key = kept.key_of_value(small_matrices.summed_product, (MATRIX, MATRIX)) or ""
    kept.write("summed_product", key, (np.zeros(1),))
    assert values.once_and_for_all(small_matrices.summed_product)(MATRIX, MATRIX).shape == (1,)  # it is what was kept
    monkeypatch.setenv("ROVTWIN_CHECK_KEPT", "1")
    with pytest.raises(kept.WrongProgram, match="another value"):
        values.once_and_for_all(small_matrices.summed_product)(MATRIX, MATRIX)


def test_what_a_librarys_decorator_or_a_bound_method_holds_is_in_the_digest(monkeypatch):
    """By its name a function wrapped by JAX would be one with every other body that it may have."""

    def digest(value):
        description = Description()
        description.put(value)
        return description.digest()

    def wrapped(body):
        place = {"__name__": "rovtwin.core.numerics"}
        exec(f"def module_for(x): return x + {body}", place)
        monkeypatch.setattr(numerics, "module_for", jax.vmap(place["module_for"]))
        return numerics.module_for

    assert digest(wrapped("1.0")) != digest(wrapped("2.0"))
    assert digest({1: 2.0}.get) != digest({1: 3.0}.get)
    assert digest(collections.defaultdict(int)) != digest(collections.defaultdict(float))


def test_another_context_is_another_program_in_this_process_too():
    seen = []

    @jit_once
    def doubled(x):
        seen.append(jax.config.jax_default_matmul_precision)
        return x @ x

    doubled(jnp.eye(2))
    with jax.default_matmul_precision("highest"):
        doubled(jnp.eye(2))
    with jax.disable_jit():
        assert (doubled(jnp.eye(2)) == jnp.eye(2)).all()
    assert seen[:2] == [None, "highest"]


def scaled(x):
    return vars(small_matrices)["SCALE"] * x


def test_a_kept_program_holds_no_trace_from_before_a_constant_changed(folder, monkeypatch):
    """JAX keeps the traces of functions inside, whatever their constants are meanwhile."""
    home = small_matrices.__dict__
    inner = numerics.traced_once(types.FunctionType(scaled.__code__, home | {"small_matrices": small_matrices}))
    found = []
    for scale in (1.0, 5.0):
        monkeypatch.setattr(small_matrices, "SCALE", scale, raising=False)
        monkeypatch.setattr(small_matrices, "inner", inner, raising=False)

        def outer(x):
            return inner(x) + vars(small_matrices)["SCALE"]

        monkeypatch.setattr(kept, "key_of", lambda *given, scale=scale: f"{scale:040.1f}")
        found.append(float(jit_once(outer)(jnp.asarray(1.0))))
    assert found == [2.0, 10.0]
    assert len(list(folder.iterdir())) == 2


def test_shapes_are_kept_and_found_without_a_trace(folder, monkeypatch):
    traced = []
    monkeypatch.setattr(jax, "eval_shape", lambda *given, of=jax.eval_shape: traced.append(1) or of(*given))
    like = shapes_in_one_piece(small_matrices.summed_product, MATRIX, MATRIX)
    again = shapes_in_one_piece(small_matrices.summed_product, MATRIX, MATRIX)
    other = shapes_in_one_piece(small_matrices.summed_product, MATRIX, MATRIX[:, :2])
    assert len(traced) == 2 and like == again and (like.shape, other.shape) == ((3, 3), (3, 2))
    assert {file.name.rpartition("-")[0] for file in folder.iterdir()} == {"summed_product-shapes"}
