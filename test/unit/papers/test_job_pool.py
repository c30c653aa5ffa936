"""Jobs of a study in other processes."""

import os
from pathlib import Path

import pytest

from robot_energy.foundation.errors import RigError
from robot_energy_papers.job_pool import StudyRun, job_pool


def test_a_worker_that_ends_by_itself_is_named():
    with (
        pytest.raises(RigError, match="ended by itself"),
        job_pool(StudyRun(Path(), 0, 2), 1) as run,
    ):
        run(os._exit, 1).result()
