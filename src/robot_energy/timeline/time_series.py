"""Quantities over time as a table: to pandas, polars, xarray, CSV or Parquet.

None of these libraries is needed by the monitor; each is imported where it is asked for.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from importlib import import_module
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import ColumnError, ShapeError
from robot_energy.foundation.files.output_files import GENERATOR
from robot_energy.foundation.shown import Shown
from robot_energy.foundation.units import SECOND_NS

Column = NDArray[Any]


@documented
@dataclass(frozen=True)
class TimeSeries(Shown):
    """Columns over one axis of time."""

    stamp_ns: Annotated[NDArray[np.int64], "Rising, shape (W,). [ns since 1970]"]
    columns: Annotated[Mapping[str, Column], "Values by name, each of shape (W,)."]
    joint_columns: Annotated[
        Mapping[str, Column], "Values per joint by name, each of shape (W, n)."
    ] = field(default_factory=dict[str, Column])
    joint_names: Annotated[tuple[str, ...], "The n joints, in their order."] = ()
    units: Annotated[
        Mapping[str, str], "Unit of each column by its name; empty for a number without unit."
    ] = field(default_factory=dict[str, str])

    def __post_init__(self) -> None:
        for name, values in self.columns.items():
            _check(name, values, (len(self),))
        for name, values in self.joint_columns.items():
            _check(name, values, (len(self), len(self.joint_names)))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.stamp_ns)

    def __repr__(self) -> str:
        span = f", {self.time[-1]:.3f} s" if len(self) else ""
        names = ", ".join((*self.columns, *self.joint_columns))
        return f"TimeSeries({len(self)} rows{span}; joints {', '.join(self.joint_names)}; {names})"

    def __contains__(self, name: object) -> bool:
        """Whether there is a column of that name."""
        return name in self.columns or name in self.joint_columns

    def __getitem__(self, name: str) -> Column:
        """Return a column, shape (W,) or (W, n).

        Raises:
            ColumnError: If there is none of that name.
        """
        every = {**self.joint_columns, **self.columns}
        if name not in every:
            near = get_close_matches(str(name), every, n=1)
            raise ColumnError(
                f"the table has no column '{name}'",
                f"'{near[0]}'?" if near else f"one of {', '.join(every)}",
            )
        return every[name]

    @property
    def time(self) -> NDArray[np.float64]:
        """Time since the first row, shape (W,). [s]"""
        start = self.stamp_ns[:1]
        return (self.stamp_ns - start) / SECOND_NS if len(self) else np.empty(0)

    def to_dict(self) -> dict[str, Column]:
        """Return all columns flat: ``stamp_ns``, then ``name``, then ``joint.name``."""
        flat: dict[str, Column] = {"stamp_ns": self.stamp_ns, **self.columns}
        for index, joint in enumerate(self.joint_names):
            for name, values in self.joint_columns.items():
                flat[f"{joint}.{name}"] = values[:, index]
        return flat

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with the time (UTC) as index.

        Raises:
            ImportError: If pandas is not installed.
        """
        pandas = library("pandas")
        flat = self.to_dict()
        index = pandas.to_datetime(flat.pop("stamp_ns"), unit="ns", utc=True)
        return pandas.DataFrame(flat, index=index.rename("time"))

    def to_polars(self) -> Any:
        """Return a `polars.DataFrame` whose first column is the time (UTC).

        Raises:
            ImportError: If polars is not installed.
        """
        polars = library("polars")
        flat = self.to_dict()
        time = polars.Series("time", flat.pop("stamp_ns")).cast(polars.Datetime("ns", "UTC"))
        return polars.DataFrame([time, *(polars.Series(k, v) for k, v in flat.items())])

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` over ``time`` and ``joint``, with units as attributes.

        Raises:
            ImportError: If xarray is not installed.
        """
        xarray = library("xarray")
        flat = {name: ("time", values) for name, values in self.columns.items()}
        per_joint = {
            name: (("time", "joint"), values) for name, values in self.joint_columns.items()
        }
        data = xarray.Dataset(
            {**flat, **per_joint},
            coords={
                "time": self.stamp_ns.astype("datetime64[ns]"),
                "joint": list(self.joint_names),
            },
        )
        for name, unit in self.units.items():
            data[name].attrs["units"] = unit
        return data

    def to_csv(self) -> str:
        """Return the table as CSV: one line of names, NaN as an empty cell."""
        flat = self.to_dict()
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(flat)
        columns = [values.tolist() for values in flat.values()]
        for row in zip(*columns, strict=True):
            writer.writerow(["" if value != value else value for value in row])
        return text.getvalue()

    def to_parquet(self) -> bytes:
        """Return the table as a Parquet file; its metadata hold the units as JSON.

        Raises:
            ImportError: If polars is not installed.
        """
        target = io.BytesIO()
        frame = library("polars").DataFrame(self.to_dict())
        marks = {"generator": GENERATOR, "units": json.dumps({**self.units})}
        frame.write_parquet(target, metadata=marks)
        return target.getvalue()


def _check(name: str, values: Column, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise ShapeError(f"the column '{name}' has the shape {values.shape}", f"{shape}")


def library(name: str) -> Any:
    """Return a library that converts tables."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        raise ImportError(
            f"{package} is not installed; expected for this conversion. "
            f"Install it: pip install {package}."
        ) from error
