"""Read the section `identification` of a sheet: numbers that come from logs, with their joint covariance and prediction errors."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.reader import Document

FloatArray = NDArray[np.float64]

AT = ("identification",)
LISTS = ("parameters", "prior", "sd", "logarithmic", "fitted")


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """Result of the identification of a vehicle from logs.

    The value of a logarithmic parameter is `prior` exp(`sd` x), the value of any other parameter `prior` + `sd` x. The
    normalised values x are jointly normal with mean `fitted` and covariance `covariance`. For a parameter that the logs
    do not identify, x has mean 0 and nearly the prior's variance, 1.
    """

    parameters: tuple[str, ...]
    prior: FloatArray
    sd: FloatArray
    logarithmic: NDArray[np.bool_]
    fitted: FloatArray
    covariance: FloatArray
    delay: float
    """Time in s from a command to its execution; vehicle models have no such delay."""
    errors: Mapping[str, Mapping[float, float]]
    """90 % quantile of the absolute prediction error on the logs, by channel and horizon in s."""

    def values(self, x: FloatArray) -> FloatArray:
        """Return the physical values (..., n_p) of the parameters for normalised values (..., n_p)."""
        return np.where(self.logarithmic, self.prior * np.exp(self.sd * x), self.prior + self.sd * x)

    def root(self, held: Collection[str] = ()) -> FloatArray:
        """Return L (n_p, n_p), so that `fitted` + L z has the joint distribution if z is standard normal.

        Args:
            held: parameters that stay at their estimates; all other parameters get their distribution given these estimates.
        """
        # Put the held parameters first. Only the first columns of a Cholesky factor move the first parameters, so columns of
        # 0 keep the held parameters at their estimates.
        order = sorted(range(len(self.parameters)), key=lambda j: self.parameters[j] not in held)
        L = np.zeros_like(self.covariance)
        for k, j in enumerate(order):
            rest = self.covariance[order[k:], j] - L[order[k:], :k] @ L[j, :k]
            # If the pivot is 0, the earlier parameters determine this parameter, and its column stays 0.
            if rest[0] > 1e-12 * max(1.0, self.covariance[j, j]):
                L[order[k:], k] = rest / np.sqrt(rest[0])
        L[:, : sum(name in held for name in self.parameters)] = 0.0
        return L

    def draws(self, count: int, generator: np.random.Generator) -> list[dict[str, float]]:
        """Return vehicles drawn from the joint distribution: physical values by the parameters' names."""
        x = generator.multivariate_normal(self.fitted, self.covariance, size=count, method="eigh")
        values = self.values(x)
        delay = np.array([name == "delay" for name in self.parameters])
        values[:, delay] = np.maximum(values[:, delay], 0.0)
        return [dict(zip(self.parameters, row.tolist(), strict=True)) for row in values]


def of(document: Document) -> Identified | None:
    """Return the identification in a sheet; None if the sheet has no such section.

    Raises:
        VehicleError: the section breaks a rule.
    """
    if AT[0] not in document.data:
        return None
    document.section(AT, (*LISTS, "covariance", "delay", "errors", "logs", "command"))
    names = document.get((*AT, "parameters"))
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        document.fail((*AT, "parameters"), f"expected a list of names, got {names!r}")
    n = len(names)
    numbers = {key: document.numbers((*AT, key), document.get((*AT, key)), ((n,),)) for key in LISTS[1:3]}
    fitted = document.numbers((*AT, "fitted"), document.get((*AT, "fitted")), ((n,),))
    flags = document.get((*AT, "logarithmic"))
    if not isinstance(flags, list) or len(flags) != n or not all(isinstance(flag, bool) for flag in flags):
        document.fail((*AT, "logarithmic"), f"expected a list of {n} values, each true or false")
    covariance = document.numbers((*AT, "covariance"), document.get((*AT, "covariance")), ((n, n),))
    if np.max(np.abs(covariance - covariance.T)) > 1e-6 or np.linalg.eigvalsh(covariance)[0] < -1e-6:
        document.fail((*AT, "covariance"), "must be symmetric without negative eigenvalues")
    delay = float(document.numbers((*AT, "delay"), document.get((*AT, "delay")), ((),)))
    return Identified(
        parameters=tuple(names),
        prior=numbers["prior"],
        sd=numbers["sd"],
        logarithmic=np.array(flags),
        fitted=fitted,
        covariance=covariance,
        delay=delay,
        errors=_errors(document),
    )


def _errors(document: Document) -> dict[str, dict[float, float]]:
    at = (*AT, "errors")
    table: Any = document.get(at)
    if not isinstance(table, Mapping):
        document.fail(at, f"expected a mapping of channels to their horizons, got {table!r}")
    errors: dict[str, dict[float, float]] = {}
    for channel, row in table.items():
        if not isinstance(row, Mapping):
            document.fail((*at, str(channel)), f"expected a mapping of horizons to their errors, got {row!r}")
        keys = [_horizon(document, str(channel), str(key)) for key in row]
        values = document.numbers((*at, str(channel)), list(row.values()), ((len(row),),))
        errors[str(channel)] = {float(key): float(value) for key, value in zip(keys, values, strict=True)}
    return errors


def _horizon(document: Document, channel: str, key: str) -> float:
    """Return the horizon in s of a key such as `0.5_s`."""
    try:
        return float(key.removesuffix("_s"))
    except ValueError:
        document.fail((*AT, "errors", channel, key), "expected a horizon such as 0.5_s")
