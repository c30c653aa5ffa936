"""The script that a workspace puts on the path."""

import runpy

from places import ROOT


def test_a_worker_process_that_reads_the_script_runs_no_command():
    # multiprocessing runs the main file of its parent under this name, with the parent's arguments.
    path = ROOT / "src/bin/robot-energy"
    assert "main" in runpy.run_path(str(path), run_name="__mp_main__")
