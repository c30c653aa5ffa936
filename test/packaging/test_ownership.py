"""Every package names one owner; every source file has a header that `ament_copyright` knows."""

import re
import runpy

from places import ROOT

OWNERSHIP = runpy.run_path(str(ROOT / ".ci/ownership.py"))


def test_every_file_says_whose_it_is():
    differing = [path for path, text, new in OWNERSHIP["wanted"]() if text != new]
    assert differing == [], "run: python .ci/ownership.py --fix"


def test_the_notice_is_that_of_the_licence():
    """`ament_copyright` compares the words, without their white space."""
    licence = " ".join((ROOT / "LICENSE").read_text().split())
    assert OWNERSHIP["NOTICE"] in licence
    for suffix, mark in OWNERSHIP["COMMENTS"].items():
        first, *lines = OWNERSHIP["header"](suffix).splitlines()
        assert re.fullmatch(rf"{mark}Copyright \d{{4}} \S.*", first)
        assert " ".join(line.removeprefix(mark) for line in lines) == OWNERSHIP["NOTICE"]


def test_a_header_is_put_before_the_text_and_in_place_of_an_old_one():
    with_header, header = OWNERSHIP["with_header"], OWNERSHIP["header"](".py")
    plain = '"""What it is."""\n\n# The License. It is below.\nvalue = 1\n'
    assert with_header(plain, ".py") == f"{header}\n{plain}"
    assert with_header(f"{header}\n{plain}", ".py") == f"{header}\n{plain}"
    old = re.sub("Copyright .*", "Copyright 2020 Somebody", header)
    assert with_header(f"#!/usr/bin/env python3\n{old}\n{plain}", ".py") == (
        f"#!/usr/bin/env python3\n{header}\n{plain}"
    )
    assert with_header("", ".py") == ""
