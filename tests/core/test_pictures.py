"""Pictures in MCAP: what goes in comes out, here and in another reader."""

import pytest

from rovtwin.core.errors import LogError
from rovtwin.core.log.pictures import TYPE, PictureWriter, read_pictures

PICTURES = [(0.1, 0.15, b"\xff\xd8one"), (0.2000000005, 0.31, b"\xff\xd8" + bytes(range(256))), (12.5, 12.5, b"")]


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "port_camera.mcap"
    with PictureWriter(path, "port.camera") as pictures:
        for one in PICTURES:
            pictures.write(*one)
    return path


def test_what_goes_in_comes_out(written):
    found = list(read_pictures(written))
    assert [data for _, data in found] == [data for _, _, data in PICTURES]
    assert [t for t, _ in found] == pytest.approx([t for t, _, _ in PICTURES], abs=1e-9)


def test_rosbags_reads_them_as_a_ros_message(written):
    pytest.importorskip("rosbags")
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with open(written, "rb") as stream:
        messages = [(s.name, c.topic, m) for s, c, m in make_reader(stream).iter_messages()]
    for (taken, delivered, data), (schema, topic, message) in zip(PICTURES, messages, strict=True):
        picture = store.deserialize_cdr(message.data, TYPE)
        assert (schema, topic) == (TYPE, "/camera/port_camera")
        assert message.log_time == round(delivered * 1e9)
        assert picture.header.stamp.sec * 10**9 + picture.header.stamp.nanosec == round(taken * 1e9)
        assert (picture.header.frame_id, picture.format, bytes(picture.data)) == ("port.camera", "jpeg", data)


def test_a_damaged_byte_is_reported_and_never_a_traceback(written, tmp_path):
    data = written.read_bytes()
    whole = list(read_pictures(written))
    for at in range(0, len(data), 7):
        changed = bytearray(data)
        changed[at] ^= 0x5A
        path = tmp_path / "damaged.mcap"
        path.write_bytes(changed)
        reports = []
        try:
            found = list(read_pictures(path, damaged=reports.append))
        except LogError:
            continue  # magic, declaration or end of the file
        assert reports or found == whole


def test_bad_files_are_named(written, tmp_path):
    with pytest.raises(LogError, match="exists"):
        PictureWriter(written, "port.camera")
    with pytest.raises(LogError, match="found topics with pictures: /camera/port_camera; expected /camera/other"):
        list(read_pictures(written, "/camera/other"))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(written.read_bytes()[:-100])
    with pytest.raises(LogError, match="unfinished"):
        list(read_pictures(cut))
    with pytest.raises(LogError, match="no such file"):
        list(read_pictures(tmp_path / "none.mcap"))
