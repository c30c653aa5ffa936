"""``python -m robot_energy``: the command `robot-energy`."""

import sys

from robot_energy.cli import main

sys.exit(main())
