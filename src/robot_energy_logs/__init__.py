"""Logs of robots (CSV, Parquet) -> bags that replay like any other."""
