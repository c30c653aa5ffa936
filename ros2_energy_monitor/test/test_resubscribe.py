# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""When a silent subscription is made again."""

from __future__ import annotations

from ros2_energy_monitor.base.inbox import MAX_WAIT, ResubscribePolicy


def trials(revival: ResubscribePolicy, start: int, stop: int, publishers: int = 1) -> list[int]:
    """Seconds at which it is time to subscribe again."""
    return [second for second in range(start, stop) if revival.due(float(second), publishers)]


def test_the_wait_doubles_up_to_a_limit():
    revival = ResubscribePolicy(10.0)
    assert trials(revival, 0, 400) == [10, 30, 70, 150, 270, 390]
    assert MAX_WAIT == 120.0


def test_nothing_is_tried_without_a_publisher():
    revival = ResubscribePolicy(10.0)
    assert trials(revival, 0, 100, publishers=0) == []
    assert trials(revival, 100, 115) == [109]  # counts from when the publisher came


def test_data_after_a_trial_are_its_success():
    revival = ResubscribePolicy(10.0)
    revival.heard(0.0)
    assert trials(revival, 1, 11) == [10]
    revival.heard(10.5)
    assert trials(revival, 11, 31) == [21]


def test_a_topic_that_is_silent_by_nature_is_left_alone():
    revival = ResubscribePolicy(10.0)
    revival.heard(0.0)
    assert trials(revival, 1, 25) == [10]
    revival.heard(25.0)  # came by itself: such a silence says nothing
    assert trials(revival, 26, 74) == []
    assert trials(revival, 74, 80) == [75]
