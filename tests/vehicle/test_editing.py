"""Vehicle files edited as text: parts come and go, all else stays to the letter."""

import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import parse_yaml
from rovtwin.vehicle.outfitting.editing import with_parts, without_part, written

DVL = {"name": "dvl", "part": "dvl_a50", "pose": {"position": [-0.2, 0.0, 0.16]}}
BLOCK = """# top
name: a
parts:   # what it is made of
  # first
  - name: p
    part: double_blueye   # inline
    pose:
      position: [0, 0, 0]

  - {name: q, part: uhi}  # q
  # trailing

restoring: {buoyancy: neutral}  # end"""
FLOW = "name: a\nparts: [{name: p, part: uhi},\n  {name: q, part: uhi}] # c\nmass: 1\n"
FILES = {
    "block": BLOCK,
    "flow": FLOW,
    "no indent": "name: a\nparts:\n- name: p\n  mass: 3\n  source: |\n    two\n    lines\n- name: q\n  mass: 1",
    "comment with a dash": "name: a\nparts:\n  - name: p # - not - this\n    mass: 3\n  - {name: q, mass: 2}\n",
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES)
def test_a_part_is_added_and_removed_again(text):
    data = parse_yaml(text, "v.yaml")
    longer = with_parts(text, [DVL, {"name": "lamp", "mass": 0.4}], "v.yaml")
    expected = data | {"parts": [*data["parts"], DVL, {"name": "lamp", "mass": 0.4}]}
    assert parse_yaml(longer, "v.yaml") == expected
    back = without_part(without_part(longer, "lamp", "v.yaml"), "dvl", "v.yaml")
    assert back.rstrip() == text.rstrip()


@pytest.mark.parametrize("text", FILES.values(), ids=FILES)
def test_any_part_can_go_and_comments_stay(text):
    data = parse_yaml(text, "v.yaml")
    for name, other in (("p", 1), ("q", 0)):
        shorter = without_part(text, name, "v.yaml")
        assert parse_yaml(shorter, "v.yaml") == data | {"parts": [data["parts"][other]]}
        emptied = without_part(shorter, data["parts"][other]["name"], "v.yaml")
        assert parse_yaml(emptied, "v.yaml") == data | {"parts": []}
        if text == BLOCK:
            assert all(comment in emptied for comment in ("# top", "# what it", "# first", "# trailing", "# end"))


@pytest.mark.parametrize("text", ["name: a\nmass: 3", "name: a\nparts: []\n", "{name: a, mass: 3}\n"])
def test_a_first_part(text):
    data = parse_yaml(text, "v.yaml")
    assert parse_yaml(with_parts(text, [DVL], "v.yaml"), "v.yaml") == data | {"parts": [DVL]}


LAYOUTS = {
    "dash on its own line": "name: a\nparts:\n  -\n    name: hull\n    mass: 2\nmass: 1\n",
    "quoted key": 'name: a\n"parts":\n  - name: hull\n    mass: 2\n',
    "comma at the end": "name: a\nparts: [{name: hull},]\n",
    "comma on the line before the end": "name: a\nparts: [\n  {name: hull},\n]\n",
    "anchor": "name: a\nparts: &p\n  - name: hull\n",
    "flow root": "{name: a, mass: 1, parts: [{name: hull}]}\n",
}


@pytest.mark.parametrize("text", LAYOUTS.values(), ids=LAYOUTS)
def test_every_layout_of_a_list_is_edited(text):
    data = parse_yaml(text, "v.yaml")
    assert parse_yaml(with_parts(text, [DVL], "v.yaml"), "v.yaml") == data | {"parts": [*data["parts"], DVL]}
    assert parse_yaml(without_part(text, "hull", "v.yaml"), "v.yaml") == data | {"parts": []}


def test_an_edit_that_would_change_something_else_is_refused():
    text = (
        "name: a\nvisuals: &p [{name: lamp}]\nmass: 1\n..."  # what comes after the end of a document is no part of it
    )
    with pytest.raises(ConfigError, match="v.yaml: .*edit the file by hand"):
        with_parts(text, [DVL], "v.yaml")


@pytest.mark.parametrize(
    "text, name, message",
    [
        (BLOCK, "r", "v.yaml: no part 'r': its parts are p, q."),
        ("name: a", "r", "v.yaml: no part 'r': it has no parts"),
        ("name: a\nspare: &x {name: r}\nparts:\n  - {name: q}\n  - *x", "q", "edit the file by hand"),
        ("name: a\nparts: 3", "q", "edit the file by hand"),
        ("parts: [", "r", "not YAML"),
    ],
)
def test_what_cannot_be_edited_is_reported(text, name, message):
    with pytest.raises(ConfigError) as error:
        without_part(text, name, "v.yaml")
    assert message in str(error.value)


def test_data_is_written_short_and_read_back():
    data = {
        "name": "v",
        "description": "a: b # c",
        "water_density": 1025.0,
        "parts": [DVL, {"name": "yes", "mass": 1e-5, "source": 'it\'s "so"'}, {"name": "z", "shape": None}],
    }
    assert parse_yaml(written(data), "v.yaml") == data
