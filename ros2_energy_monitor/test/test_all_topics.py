# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The bag of all topics: every topic comes, and what is written can be replayed."""

from __future__ import annotations

import sys
from pathlib import Path

from rclpy.context import Context

from robot_energy.bag import BagReader
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay

sys.path.append(str(Path(__file__).resolve().parent))
from all_topics import TYPES, record, write


def test_a_short_recording_has_every_topic(bench, tmp_path):
    context: Context = bench.context
    recorder = record(context, 0.2)
    write(recorder, str(tmp_path / "bag"), overwrite=False)
    reader = BagReader(tmp_path / "bag")
    assert set(reader.topics) == set(TYPES)
    for topic, info in reader.topics.items():
        assert info.msgtype == TYPES[topic]
    times = [time_ns for _, time_ns, _ in recorder.taken]
    assert times == sorted(times)
    done = replay(tmp_path / "bag", load("kr16"))
    assert done.joint_states.rejections.accepted == recorder.counts["/joint_states"]
