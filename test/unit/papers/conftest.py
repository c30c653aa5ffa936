"""What several studies work out is worked out once."""

import pytest

from robot_energy_papers.wall_sensitivity import wall_tables
from robot_energy_studies.band_coverage import DrawnRig


@pytest.fixture(scope="session")
def walls():
    """Sensitivity of the gantry over the arm, in the short form."""
    return wall_tables(quick=True)


@pytest.fixture(scope="session", autouse=True)
def one_identification():
    """What `DrawnRig` identifies without gears, by plant, effects and recordings."""
    known = {}
    identified = DrawnRig.identified

    def once(rig, training, warm_up=None):
        if warm_up is not None:
            return identified(rig, training, warm_up)
        key = repr((rig._profile, rig._config, tuple(training)))
        if key not in known:
            known[key] = identified(rig, training)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DrawnRig, "identified", once)
        yield
