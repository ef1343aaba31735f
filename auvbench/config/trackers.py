"""Define the spec of a tracker."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.registry import Spec


@dataclass(frozen=True, slots=True)
class TrackerSpec(Spec):
    """Description of one value of `train.log`, available without importing its client."""

    name: str
    """Value of `train.log` and of `--log`."""
    module: str
    """Module with the functions of `tracking.Service`."""
    extra: str = ""
    """Extra of auvbench that installs the tracker's client; empty for a tracker of a package."""
    schema: None = None

    @property
    def code(self) -> str:
        """Return `module`, which is the tracker's code."""
        return self.module
