"""Files of XML in the encodings that they state."""

import pytest

from robot_energy.foundation.config_file import read_text
from robot_energy.foundation.errors import ModelFileError
from robot_energy.foundation.files.regular_file import xml_encoding

TEXT = '<?xml version="1.0" encoding="{}"?>\n<robot name="Käfer"/>\n'


@pytest.mark.parametrize(
    ("declared", "encoding"),
    [
        ("utf-8", "utf-8"),
        ("UTF-8", "utf-8-sig"),
        ("ISO-8859-1", "latin-1"),
        ("windows-1252", "cp1252"),
        ("UTF-16", "utf-16"),
        ("UTF-16", "utf-16-le"),
        ("utf-16", "utf-16-be"),
        ("utf-16", "utf-8"),  # which cannot be true
        ("utf-8", "utf-32"),
    ],
)
def test_the_encoding_is_what_mark_or_declaration_say(declared, encoding, tmp_path):
    text, path = TEXT.format(declared), tmp_path / "robot.urdf"
    path.write_bytes(text.encode(encoding))
    found = read_text(path, ModelFileError, "URDF", encoding_of=xml_encoding)
    assert found == text


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (TEXT.format("utf-8").encode("latin-1"), 'UTF-8.*encoding="ISO-8859-1"'),
        (TEXT.format("klingon").encode(), "unknown encoding: klingon"),
        (TEXT.format("rot13").encode(), "no known encoding"),
        ("<robot/>".encode("utf-16")[:-1], "UTF-16"),
    ],
)
def test_other_bytes_are_refused_with_the_encoding(data, words, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes(data)
    with pytest.raises(ModelFileError, match=words):
        read_text(path, ModelFileError, "URDF", encoding_of=xml_encoding)
