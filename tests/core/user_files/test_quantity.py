"""Quantities as people type them."""

import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.quantity import (
    DENSITY,
    LENGTH,
    MASS,
    is_finite,
    is_number,
    named_unit,
    plain,
    point,
    positive,
    quantity,
)


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("20mm", LENGTH, 0.02), ("20 mm", LENGTH, 0.02), (" 2 cm ", LENGTH, 0.02), ("0.02", LENGTH, 0.02),
        ("-1e-2 m", LENGTH, -0.01), (".5", LENGTH, 0.5), ("5.", LENGTH, 5.0), ("+3", LENGTH, 3.0),
        ("200 g", MASS, 0.2), ("1e3g", MASS, 1.0), ("1.025g/cm3", DENSITY, 1025.0), ("1025 kg/m3", DENSITY, 1025.0),
    ],
)  # fmt: skip
def test_number_and_unit(text, kind, value):
    assert quantity(text, kind, "--x") == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    "text", ["", "mm", "nan", "inf", "1e999", "0,02", "20 mm mm", "2 kg", "two", "1/2", "0x10", "20m m"]
)
def test_what_is_no_length_says_what_is(text):
    with pytest.raises(ConfigError, match="--x: found .*expected a length such as 20mm; units: m, cm, mm"):
        quantity(text, LENGTH, "--x")


def test_points_and_positive_quantities():
    assert point("200mm, 0,-0.1", "--at") == pytest.approx((0.2, 0.0, -0.1))
    with pytest.raises(ConfigError, match="--at: found '1,2', expected x,y,z"):
        point("1,2", "--at")
    with pytest.raises(ConfigError, match="above 0"):
        positive("0g", MASS, "--x")


def test_numbers_in_sentences_have_no_powers_of_ten():
    assert [plain(x) for x in (142.3, 99.7, 7.04, 0.0123, -0.0, 51900.0)] == ["142", "100", "7", "0.012", "0", "51900"]
    assert plain(51912.4, 3) == "51912"


@pytest.mark.parametrize(
    ("name", "plain_name", "unit"),
    [
        ("rate_hz", "rate", "Hz"), ("heading_rms_deg", "heading_rms", "deg"), ("speed_m_s", "speed", "m/s"),
        ("thruster_activity_n_per_s", "thruster_activity", "N/s"), ("saturated_share", "saturated", "1"),
        ("nees_position_mean", "nees_position_mean", ""), ("m", "m", ""),
    ],
)  # fmt: skip
def test_a_name_says_its_unit_by_how_it_ends(name, plain_name, unit):
    assert named_unit(name) == (plain_name, unit)


def test_true_and_false_are_no_numbers_nor_is_infinity_finite():
    assert [is_number(one) for one in (1, 0.5, float("inf"), True, "1", None)] == [True] * 3 + [False] * 3
    assert [is_finite(one) for one in (1, 10**400, float("inf"), float("nan"), False)] == [True, *[False] * 4]
