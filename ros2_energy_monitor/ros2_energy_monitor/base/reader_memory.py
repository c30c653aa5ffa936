# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Memory of nodes that listen to many robots: Fast DDS makes room for messages as they come.

By default it makes room for 100 samples in every reader and writer, 90 kB each, however deep the
queue is and however little arrives. Of a robot a recorder has two readers and a client.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = Path(__file__).with_name("fast_dds.xml")
VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # of the environment; other middleware ignores it
OF_THE_FOLDER = "DEFAULT_FASTRTPS_PROFILES.xml"  # is read where that names none


def make_room_as_needed() -> None:
    """Let readers and writers begin small, unless the user has profiles; before ROS is started."""
    if not Path(OF_THE_FOLDER).exists():
        os.environ.setdefault(VARIABLE, str(PROFILES))
