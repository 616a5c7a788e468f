"""Evidence of one's own: found, checked before anything is fitted, and counted as what it is worth."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.packages import install

import rovtwin
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.trust import VARIABLE
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.own_evidence import OwnEvidence, about_own
from rovtwin.planning.known import what_is_known
from rovtwin.testing import check_evidence

pytestmark = pytest.mark.system

SOURCE = """
from rovtwin.identification.own_evidence import OwnEvidence
class Weighed(OwnEvidence):
    newtons: float
    def measured(self): return self.newtons
    def deviation(self): return 0.5
    def predict(self, model): return model.buoyancy
nothing = 3
"""


@jax.custom_vjp
def _backwards(x):
    return 2.0 * x


_backwards.defvjp(lambda x: (2.0 * x, None), lambda _, g: (2.0 * g,))


class Kind(OwnEvidence):
    """Of the buoyancy, spoiled by what a test says."""

    newtons: float = 290.0
    how: str = ""

    def measured(self):
        return [1.0, 2.0] if self.how == "shape" else self.newtons

    def deviation(self):
        return -1.0 if self.how == "sd" else 0.5

    def predict(self, model):
        if self.how == "fails":
            raise ValueError("no idea")
        if self.how == "branches" and model.buoyancy > 0:
            return model.buoyancy
        if self.how == "shape compiled" and isinstance(model.buoyancy, jax.core.Tracer):
            return jnp.stack([model.buoyancy, model.weight])
        if self.how == "numpy":
            return np.sqrt(np.asarray(model.buoyancy))
        if self.how == "backwards":
            return _backwards(model.buoyancy)
        if self.how == "nan":
            return jnp.nan * model.buoyancy
        if self.how == "constant":
            return jnp.asarray(1.0)
        if self.how == "held back":
            return jax.lax.stop_gradient(model.buoyancy) + model.buoyancy
        return model.buoyancy


@pytest.fixture(scope="module")
def known():
    return what_is_known(rovtwin.load_vehicle("double_blueye"), None)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    import sys

    monkeypatch.setenv(VARIABLE, "")
    points = {"rovtwin.evidence": {"weighed": "weighing:Weighed"}}
    monkeypatch.syspath_prepend(install(tmp_path / "site", "weighing", SOURCE, points))
    yield
    sys.modules.pop("weighing", None)


def test_the_residual_is_in_standard_deviations(known):
    parameters, _ = known
    residuals = static_evidence(
        parameters, [Kind(newtons=1.0), {"towing": {"direction": "surge", "speed": [0.1], "force": [1.0], "sd": 1.0}}]
    )
    (first, _) = np.asarray(residuals(jnp.zeros(len(parameters.names))))
    assert first == pytest.approx((float(parameters.model.buoyancy) - 1.0) / 0.5)


def test_a_file_names_it_by_entry_point_or_by_address_with_consent(known, installed, monkeypatch):
    parameters, _ = known
    theta = jnp.zeros(len(parameters.names))
    by_name = static_evidence(parameters, [{"kind": "weighed", "settings": {"newtons": 300.0}}])
    with pytest.raises(ConfigError, match=r"anchors\[0\]: names code, weighing:Weighed, .* a file runs code only with"):
        static_evidence(parameters, [{"kind": "weighing:Weighed", "settings": {"newtons": 300.0}}])
    monkeypatch.setenv(VARIABLE, "weighing:Weighed")
    by_address = static_evidence(parameters, [{"kind": "weighing:Weighed", "settings": {"newtons": 300.0}}])
    assert by_name(theta) == by_address(theta)
    (line,) = about_own([{"kind": "weighed"}])
    assert line == "evidence of one's own: weighed (weighing 1.0)"
    assert "weighing:Weighed (" in about_own([{"kind": "weighing:Weighed"}])[0]


@pytest.mark.parametrize(
    ("anchor", "why"),
    [
        ({"kind": "weighed", "settings": {"newton": 1.0}}, r"\[0\]: weighed: newton: no such key. Did you mean 'newt"),
        ({"kind": "weighed"}, r"anchors\[0\]: weighed: newtons: missing"),
        ({"kind": "weighd"}, r"anchors\[0\]: found 'weighd', .*entry point \(one of weighed\) Did you mean 'weighed'"),
        ({"kind": "weighing:nothing"}, r"weighing:nothing: found int, expected a class of .*OwnEvidence"),
        ({"kind": "weighing:Weigh"}, r"found no 'Weigh' in weighing, .*Did you mean 'Weighed'"),
        ({"settings": {"newtons": 1.0}}, "expected one of bollard, towing, kind"),
        ({"bollard": {"direction": "surge", "force": 1.0, "sd": 1.0}, "settings": {"a": 1}}, "settings: expected none"),
        ({"bollard": {"direction": "surge", "force": 1.0, "sd": 1.0}, "kind": "weighed"}, "expected one of bollard"),
        (Kind(how="fails"), r"anchors\[0\]: Kind.predict failed: ValueError: no idea"),
        (Kind(how="nan"), r"Kind.predict gave \[nan\], expected finite numbers"),
        (Kind(how="branches"), r"anchors\[0\]: Kind.predict cannot be differentiated by JAX: TracerBool.*jnp.where"),
        (Kind(how="numpy"), "Kind.predict cannot be differentiated by JAX: TracerArrayConversionError"),
        (Kind(how="backwards"), "Kind.predict cannot be differentiated by JAX: TypeError"),
        (Kind(how="shape compiled"), r"Kind.predict gives shape \(2,\) compiled, \(1,\) otherwise"),
        (Kind(how="shape"), "found 1 predicted, 2 measured and 1 standard deviations"),
        (Kind(how="sd"), r"Kind.deviation gave \[-1.0\], expected numbers above 0"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_before_anything_is_fitted(known, installed, monkeypatch, anchor, why):
    monkeypatch.setenv(VARIABLE, "1")
    with pytest.raises((ConfigError, IdentificationError), match=why):
        static_evidence(known[0], [anchor])


def test_the_contract_holds_what_is_sound():
    check_evidence(Kind())


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("fails", "Kind.predict failed: ValueError"),
        ("nan", "expected finite numbers"),
        ("branches", "cannot be compiled: TracerBoolConversionError.*jnp.where"),
        ("backwards", "cannot be differentiated by JAX"),
        ("constant", "depends on none of the parameters"),
        ("held back", "differs from that by differences"),
    ],
)
def test_the_contract_names_what_is_not(how, why):
    with pytest.raises(AssertionError, match=why):
        check_evidence(Kind(how=how))


def test_a_block_is_no_evidence():
    with pytest.raises(AssertionError, match="found int, expected an OwnEvidence"):
        check_evidence(3)  # type: ignore[arg-type]
