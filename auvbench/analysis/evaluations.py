"""Read and check one evaluation of a run, so that no row of a damaged evaluation enters a table.

The files of a run must agree with their recorded digests, with each other, and with the run's id.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auvbench.analysis.damage import Damage
from auvbench.analysis.records import Evaluation, RunRecord
from auvbench.runs import identity, integrity


def disagreement(manifest: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """Return how a manifest differs from the run that config.yaml describes; '' if they agree."""
    if wrong := identity.mismatch(config, str(manifest["id"])):
        return f"config.yaml does not belong to the run {manifest['id']}: {wrong}"
    for key, configured in (("seed", config["seed"]), ("algo", config["algo"]["name"])):
        if manifest[key] != configured:
            return f"manifest.json has the {key} {manifest[key]}, but config.yaml has {configured}"
    return ""


def evaluation_of(run: RunRecord, protocol: str) -> Evaluation:
    """Read the evaluation of a run by a protocol.

    Raises:
        Damage: the evaluation cannot be used, was changed, or its files disagree.
    """
    summary, episodes = run.source.test(protocol)
    return Evaluation(protocol, summary["fingerprint"], summary, episodes)


def check_belongs(manifest: Mapping[str, Any], evaluation: Evaluation) -> None:
    """Check that an evaluation belongs to this run, to the run's present model, and to the protocol of the evaluation's folder.

    Raises:
        Damage: the evaluation belongs to another run, model or protocol.
    """
    summary, wrong = evaluation.summary, ""
    if summary["run"] != manifest["id"]:
        wrong = f"it belongs to the run {summary['run']}"
    elif summary["protocol"] != evaluation.protocol:
        wrong = f"it belongs to the protocol {summary['protocol']}"
    elif summary["model"] != integrity.digests(manifest, "model/"):
        wrong = "the run's model has changed since the test: evaluate again"
    if wrong:
        raise Damage(wrong, "foreign")
