"""Tables over time: what goes in comes out of every form."""

import csv
import io
import json

import numpy as np
import pytest

from robot_energy.foundation.errors import ShapeError
from robot_energy.model import load
from robot_energy.timeline.time_series import TimeSeries

SERIES = TimeSeries(
    stamp_ns=np.array([10**18, 10**18 + 20_000_000]),
    columns={"grid_power": np.array([250.0, np.nan]), "phase": np.array([1, 2])},
    joint_columns={"friction_power": np.array([[1.5, 2.5], [3.5, 4.5]])},
    joint_names=("a1", "a2"),
    units={"grid_power": "W", "friction_power": "W"},
)


def test_columns_are_found_by_name_and_time_counts_from_the_first_row():
    assert SERIES["friction_power"].shape == (2, 2)
    assert SERIES.time.tolist() == [0.0, 0.02]
    assert list(SERIES.to_dict()) == [
        "stamp_ns", "grid_power", "phase", "a1.friction_power", "a2.friction_power",
    ]  # fmt: skip


def test_csv_keeps_every_digit_and_leaves_unmeasured_cells_empty():
    rows = list(csv.DictReader(io.StringIO(SERIES.to_csv())))
    assert int(rows[1]["stamp_ns"]) == 10**18 + 20_000_000
    assert rows[1]["grid_power"] == ""
    assert float(rows[1]["a2.friction_power"]) == 4.5


def test_it_says_what_it_holds_in_one_line():
    assert repr(SERIES) == (
        "TimeSeries(2 rows, 0.020 s; joints a1, a2; grid_power, phase, friction_power)"
    )
    assert "friction_power" in SERIES
    assert "speed" not in SERIES
    assert repr(load("kr16")).startswith("RobotModel('KR 16 class', 6 joints, id ")


def test_a_column_of_another_length_is_refused():
    with pytest.raises(ShapeError, match="power"):
        TimeSeries(np.array([1, 2]), {"power": np.zeros(3)})


@pytest.mark.parametrize("library", ["pandas", "polars", "xarray"])
def test_a_library_that_is_not_there_is_named(library, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, library, None)
    with pytest.raises(ImportError, match=f"pip install {library}"):
        getattr(SERIES, f"to_{library}")()


def test_pandas_has_the_time_as_index():
    pytest.importorskip("pandas")
    frame = SERIES.to_pandas()
    assert frame.index[0].value == 10**18
    assert frame["a1.friction_power"].tolist() == [1.5, 3.5]


def test_polars_has_the_time_as_first_column():
    pytest.importorskip("polars")
    frame = SERIES.to_polars()
    assert frame.columns[0] == "time"
    assert frame["a2.friction_power"].to_list() == [2.5, 4.5]


def test_xarray_has_joints_as_a_dimension_and_units():
    pytest.importorskip("xarray")
    data = SERIES.to_xarray()
    assert data["friction_power"].sel(joint="a2").values.tolist() == [2.5, 4.5]
    assert data["grid_power"].attrs["units"] == "W"


def test_parquet_reads_back_with_units():
    polars = pytest.importorskip("polars")
    content = io.BytesIO(SERIES.to_parquet())
    assert polars.read_parquet(content)["a1.friction_power"].to_list() == [1.5, 3.5]
    assert json.loads(polars.read_parquet_metadata(content)["units"])["grid_power"] == "W"
