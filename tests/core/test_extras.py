"""A missing package of an extra is named with the command that installs it."""

import sys

import pytest

from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.core.extras import imported, installed, require


def test_what_is_there_is_found_and_imported():
    require("numpy", "none", "nobody")
    assert installed("numpy.linalg") and imported("numpy", "none", "nobody") is sys.modules["numpy"]


@pytest.mark.parametrize("module", ["nothing_of_the_kind", "nothing_of_the_kind.inside"])
def test_what_is_missing_is_named_with_the_extra(module):
    assert not installed(module)
    with pytest.raises(ConfigError, match=r"a survey needs nothing_of_the_kind.*pip install 'rovtwin\[survey\]'"):
        require(module, "survey", "a survey")
    with pytest.raises(LinkError, match=r"rovtwin\[survey\]"):
        imported(module, "survey", "a survey", LinkError)


def test_what_cannot_be_imported_is_reported(tmp_path, monkeypatch):
    (tmp_path / "half_installed.py").write_text("import nothing_of_the_kind")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="half_installed, which is installed but cannot be imported: No module"):
        imported("half_installed", "vision", "a picture")
