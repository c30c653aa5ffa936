# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Credentials of a server on the network: read from a file that only its owner can read."""

from __future__ import annotations

from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, SecretStr

from robot_energy.foundation.config_file import load
from robot_energy.foundation.errors import CredentialsError
from robot_energy.foundation.files.regular_file import require_private

LOOPBACK = ("127.0.0.1", "::1", "localhost")


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    username: str
    password: SecretStr


@dataclass(frozen=True)
class Credentials:
    """A name and a password; the password is in no text of the object."""

    username: str
    password: str = field(repr=False)


def read_credentials(path: str) -> Credentials | None:
    """Return ``username`` and ``password`` of a YAML file; None for an empty path.

    Args:
        path: The file; empty for none.
    """
    if not path:
        return None
    full = require_private(path, "file of credentials")
    found = load(full, _File, CredentialsError, "file of credentials")
    return Credentials(found.username, found.password.get_secret_value())
