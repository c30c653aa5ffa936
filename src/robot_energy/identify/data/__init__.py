"""Recordings prepared for identification."""
