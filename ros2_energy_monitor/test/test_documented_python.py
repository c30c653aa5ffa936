# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Python of the how-tos that needs ROS, run as it stands against a node."""

import re
import subprocess
import sys
from pathlib import Path

from sensor_msgs.msg import JointState

from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

DOCUMENTS = Path(__file__).resolve().parents[2] / "src/doc"


def test_the_energy_of_a_job_from_python(loopback_bench, child_environment, messages, tmp_path):
    bench, states = loopback_bench, messages["/joint_states"]
    text = (DOCUMENTS / "howto_registers.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    node = bench.add(EnergyMonitor, model="kr16", state_folder=str(tmp_path))
    publisher = bench.publisher(JointState, "joint_states")
    for row in states[:200]:
        publisher.publish(row)
    bench.spin_until(lambda: node.account.totals().observed_ns > 0, "counted joint states")
    job = subprocess.Popen(
        [sys.executable, "-c", code], env=child_environment, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    with job:
        intervals = node.account.intervals
        bench.spin_until(lambda: intervals.open_entries or job.poll() is not None, "an interval")
        before = node.account.totals().observed_ns
        for row in states[200:600]:
            publisher.publish(row)
        bench.spin_until(lambda: node.account.totals().observed_ns > before + 10**8, "motion")
        job.stdin.write("\n")
        job.stdin.flush()
        bench.spin_until(lambda: job.poll() is not None, "the end of the job")
        out, err = job.communicate()
    assert job.returncode == 0, err
    energy, band, seconds = re.search(r"(\d+) \+- (\d+) J in ([\d.]+) s$", out).groups()
    assert float(energy) > 0
    assert float(band) > 0
    assert float(seconds) > 0
