"""Encodings, comments and headers of texts, and the cells that offend."""

import gzip
import re

import numpy as np
import pytest
import yaml

from logbook import WHEEL_MAPPING, mapping, read_bag, table_rows, write_csv
from robot_energy.foundation.errors import LogFormatError
from robot_energy_cli import main
from robot_energy_logs.log_import import import_log
from robot_energy_logs.table import LogTable

HEADER = "t,q_axle,w_axle,p"
ROWS = ("0,1,0,50", "1,1.5,0.5,60")
TEMPERATURE = "\N{DEGREE SIGN}C"


def imported(folder, text, **changes):
    """What becomes of a table that is written as it stands."""
    (folder / "log.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    return import_log(folder / "log.csv", mapping(**changes), folder / "bag", overwrite=True)


def lines(*rows):
    return "\n".join([*rows, ""])


@pytest.mark.parametrize(
    ("encoding", "note"),
    [
        ("utf-8", ""),
        ("utf-8-sig", ""),
        ("cp1252", "Windows-1252"),
        ("utf-16", "UTF-16"),
        ("utf-16-be", "UTF-16-BE"),
        ("utf-32", "UTF-32"),
    ],
)
@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_encodings_are_found_and_named(tmp_path, encoding, note, pack):
    text = lines(HEADER, f"[s],[rad],[rad/s],[{TEMPERATURE}]", *ROWS)
    report = imported(tmp_path, pack(text.encode(encoding)))
    assert report.joint_states == 2
    assert report.files[0].first_line == {"not_numeric": 2}
    notes = [entry for entry in report.notes if "is read as" in entry]
    assert notes == ([f"log.csv is read as {note} text"] if note else [])


def test_an_encoding_that_is_not_found_is_stated(tmp_path):
    late = lines(HEADER, *ROWS, *["2,1,1,60"] * 20_000, f"3,1,1,{TEMPERATURE}").encode("cp1252")
    with pytest.raises(LogFormatError, match=r"not UTF-8 text.*encoding: cp1252") as caught:
        imported(tmp_path, late)
    (key, value) = re.search(r"(encoding): (\w+)", str(caught.value)).groups()
    assert imported(tmp_path, late, **{key: value}).joint_states == 3
    with pytest.raises(LogFormatError, match="not UTF-8 text"):
        imported(tmp_path, b"t,a\n\xff\x00\x01,2\n")
    with pytest.raises(LogFormatError, match="not ASCII text"):
        imported(tmp_path, late, encoding="ascii")
    for name in ("hex", "base64", "klingon", ""):
        with pytest.raises(ValueError, match="encoding"):
            mapping(encoding=name)


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        (lines("# robot 7", "#", HEADER, "# begin", ROWS[0], "", "#", ROWS[1]), {}),
        (lines(f"# {HEADER}", *ROWS), {}),  # as numpy writes it
        (lines("# made by hand", f"# {HEADER}", *ROWS), {}),
        (lines("sep=;", HEADER.replace(",", ";"), *(row.replace(",", ";") for row in ROWS)), {}),
        (lines("", "", HEADER, *ROWS), {}),
        (lines("% robot 7", HEADER, ROWS[0], "% end", ROWS[1]), {"comment": "%"}),
        (lines("robot 7", "", "cell;3", HEADER, *ROWS), {"skip_rows": 3}),
        (lines("a,b,c,d", *ROWS), {"skip_rows": 1, "column_names": HEADER.split(",")}),
        (lines("# robot 7", *ROWS), {"column_names": HEADER.split(",")}),
        (lines(HEADER, *ROWS).replace("\n", "\r"), {}),
        (lines(HEADER, *ROWS).replace("\n", "\r\n", 2), {}),
    ],
)
def test_what_stands_around_the_rows_is_left_out(tmp_path, text, changes):
    report = imported(tmp_path, text, **changes)
    assert (report.joint_states, report.files[0].received) == (2, 2)
    assert read_bag(tmp_path / "bag", ["axle"])[2].power.tolist() == [50.0, 60.0]


def test_lines_before_the_header_are_counted_for_the_remedy(tmp_path):
    text = lines("Robot: 7", "Cell; 3", "", HEADER, *ROWS)
    with pytest.raises(LogFormatError, match="skip_rows: 3 in the mapping") as caught:
        imported(tmp_path, text)
    skipped = int(re.search(r"skip_rows: (\d+)", str(caught.value))[1])
    assert imported(tmp_path, text, skip_rows=skipped).joint_states == 2


def test_lines_of_comments_count_for_the_places_of_rows(tmp_path):
    rows = ["t,a", "# b", "1,x", "# c", "2,y", "3,1"]
    _, _, account = table_rows(write_csv(tmp_path / "log.csv", "# a", rows), ["a"])
    assert account.first_line == {"not_numeric": 4}


@pytest.mark.parametrize(
    ("row", "cell", "remedy"),
    [
        ("2,x,1,60", "q_axle is 'x'", ""),
        ("2,,1,60", "q_axle is ''", ""),
        ("2,-,1,60", "q_axle is '-'", ""),
        ("2,1,1,inf", "p is 'inf'", ""),
        ("2,1,1,1e400", "p is '1e400'", ""),
        ("2,1,1,true", "p is 'true'", ""),
        ("2,1,1,60 W", "p is '60 W'", "write numbers only"),
        ('2,1,1,"60,5"', "p is '60,5'", 'decimal: ","'),
        ('2,1,1,"1,234.5"', "p is '1,234.5'", "without separators of thousands"),
        ("2,1,1", "has 3 cells", ""),
        ("soon,1,1,60", "t is 'soon'", ""),
        ("01.07.2026 12:00:00,1,1,60", "t is '01.07.2026 12:00:00'", "%d.%m.%Y %H:%M:%S"),
        ("-9e9,1,1,60", "t is '-9e9'", ""),
    ],
)
def test_the_cell_that_offends_is_shown(tmp_path, row, cell, remedy):
    with pytest.raises(LogFormatError) as caught:
        imported(tmp_path, lines(HEADER, row, row))
    assert f"from line 2 of log.csv, wh{'ich' if 'cells' in cell else 'ere'} {cell}" in str(
        caught.value
    )
    assert remedy in caught.value.remedy
    report = imported(tmp_path, lines(HEADER, *ROWS, row))  # among good rows it is counted
    assert list(report.files[0].first_line.values()) == [4]
    assert cell in report.files[0].reasons


@pytest.mark.parametrize("cell", ["", " ", "-", "n/a", "N/A", "#N/A", "NULL", "None", "NaN", "nan"])
def test_words_for_no_value_are_no_value(tmp_path, cell):
    report = imported(tmp_path, lines(HEADER, ROWS[0], f"1,1.5,0.5,{cell}"))
    assert (report.joint_states, report.readings) == (2, 1)


@pytest.mark.parametrize("cell", ["1e3", "+1000", "1000.0", " 1000 ", "1.0E+3"])
def test_numbers_in_all_their_forms(tmp_path, cell):
    imported(tmp_path, lines(HEADER, ROWS[0], f"1,1.5,0.5,{cell}"))
    assert read_bag(tmp_path / "bag", ["axle"])[2].power.tolist() == [50.0, 1000.0]


def test_a_point_between_decimal_commas_is_never_guessed(tmp_path):
    log = write_csv(
        tmp_path / "log.csv", "t;a;b", ["1;0,5;1.234", "2;0,5;1.234,5", "3;0,125;0.125"]
    )
    values, _, account = table_rows(log, ["a", "b"], decimal=",")
    assert values.tolist() == [[0.125, 0.125]]
    assert account.first_cell["not_numeric"] == ("b", "1.234")


def test_one_row_is_no_recording(tmp_path, capsys):
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(WHEEL_MAPPING))
    write_csv(tmp_path / "log.csv", HEADER, [ROWS[0], "x,1,1,60"])
    words = ["import", "table", str(tmp_path / "log.csv"), "--mapping", str(tmp_path / "map.yaml")]
    assert main([*words, "--out", str(tmp_path / "bag")]) == 2
    said = capsys.readouterr().err
    assert "only 1 of the 2 rows" in said
    assert "t is 'x'" in said
    assert not (tmp_path / "bag").exists()


def test_a_column_named_twice_is_read_under_new_names(tmp_path):
    text = lines("t,q_axle,w_axle,p,p", *(f"{row},7" for row in ROWS))
    with pytest.raises(LogFormatError, match=r"'p' .* 2 times.*column_names and skip_rows"):
        imported(tmp_path, text)
    names = [*HEADER.split(","), "p2"]
    assert imported(tmp_path, text, column_names=names, skip_rows=1).readings == 2


def test_a_unit_in_the_name_of_a_column_must_be_that_of_the_mapping(tmp_path):
    joints = {"names": ["axle"], "position": {"columns": ["q [deg]"], "unit": "rad"}}
    text = lines("t,q [deg],q(a),p (kW)", *ROWS)
    with pytest.raises(LogFormatError, match=r"'q \[deg\]' is in 'deg'.*joints.position.unit: deg"):
        imported(tmp_path, text, joints=joints, power=None)
    joints["position"]["unit"] = "deg"
    imported(tmp_path, text, joints=joints, power=None)
    assert read_bag(tmp_path / "bag", ["axle"])[0].joint_position[0] == pytest.approx(np.pi / 180)
    assert LogTable(tmp_path / "log.csv").units == {"q [deg]": "deg", "p (kW)": "kW"}


def test_a_recording_appended_with_its_header_is_a_run_of_its_own(tmp_path):
    report = imported(tmp_path, lines(HEADER, *ROWS, HEADER, *ROWS))
    assert (report.joint_states, report.end_ns - report.start_ns) == (4, 12 * 10**9)
    assert "line 4 of log.csv repeats the header" in report.notes[-1]
    assert "begins again" in report.notes[-1]
    later = ("2,1,0,50", "3,1,0,50")
    report = imported(tmp_path, lines(HEADER, *ROWS, HEADER, *later))
    assert report.end_ns - report.start_ns == 3 * 10**9
    assert "begins again" not in report.notes[-1]


def test_dates_that_step_back_after_a_header_stay_where_they_are(tmp_path):
    rows = [f"2026-07-01T12:00:0{k}Z,1,0,50" for k in (5, 6)]
    older = [row.replace("07-01", "06-01") for row in rows]
    time = {"column": "t"}
    report = imported(tmp_path, lines(HEADER, *rows, HEADER, *older), time=time)
    assert dict(report.files[0].rejected) == {"not_newer": 2}
    assert "line 4 of log.csv repeats the header" in report.notes[-1]


def test_a_plain_table_is_read_as_one_in_quotes(tmp_path):
    random = np.random.default_rng(1)
    forms = ["{:.9g}", "{:.17g}", "{:.3f}", "{:.6e}", " {:.2f}", "{:+.4f}"]
    values = random.normal(size=(30_000, 3)) * 10.0 ** random.integers(-9, 9, (30_000, 3))
    rows = [
        f"{1e9 + 0.002 * k:.{k % 7 + 3}f},"
        + ",".join(forms[(k + n) % 6].format(value) for n, value in enumerate(row))
        for k, row in enumerate(values.tolist())
    ]
    rows[20_000] = f"{1e9 + 40},,1,2"
    found = {}
    for name, head in (("plain", "t,a,b,c"), ("quoted", 't,a,b,"c"')):
        folder = tmp_path / name
        folder.mkdir()
        given = (
            rows if name == "plain" else [f'"{row.replace(",", chr(34) + ",", 1)}' for row in rows]
        )
        found[name] = table_rows(write_csv(folder / "log.csv", head, given), ["a", "b", "c"])
    for one, other in zip(found["plain"][:2], found["quoted"][:2], strict=True):
        np.testing.assert_array_equal(one, other)
    assert found["plain"][2].rejected == found["quoted"][2].rejected
    assert found["plain"][2].first_line == found["quoted"][2].first_line == {"not_finite": 20_002}


@pytest.mark.parametrize(
    ("row", "reason"),
    [("1,2", "wrong_length"), ("1,2,3,4", "wrong_length"), ("1,x,3", "not_numeric"), ("", "")],
)
def test_a_row_that_offends_is_found_behind_many_plain_ones(tmp_path, row, reason):
    rows = [f"{k},0.5,{1e-6 * k:.12f}" for k in range(100_000)]
    rows[90_000] = row
    _, _, account = table_rows(write_csv(tmp_path / "log.csv", "t,a,b", rows), ["a", "b"])
    assert account.first_line == ({reason: 90_002} if reason else {})
    assert account.accepted == 99_999
