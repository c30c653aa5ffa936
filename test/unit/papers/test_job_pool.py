"""Jobs of a study in other processes."""

import os

import pytest

from robot_energy.foundation.errors import RigError
from robot_energy_papers.job_pool import job_pool


def test_a_worker_that_ends_by_itself_is_named():
    with (
        pytest.raises(RigError, match="ended by itself"),
        job_pool(2, lambda job: None) as run,
    ):
        run(os._exit, 1).result()
