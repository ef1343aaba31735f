"""What a checkpoint is made of: named tensors, arrays and plain values, and their form as files. Nothing is unpickled."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.untrusted import archives, reading


@dataclass(slots=True)
class Components:
    """The parts of a checkpoint by name."""

    tensors: dict[str, dict[str, Any]] = field(default_factory=dict)  # state dicts -> `<name>.pt`
    arrays: dict[str, dict[str, NDArray[Any]]] = field(default_factory=dict)  # -> `<name>.npz`
    values: dict[str, Any] = field(default_factory=dict)  # plain data -> `<name>.json`

    def files(self) -> Iterator[tuple[str, bytes]]:
        """File name and content of each component.

        Raises:
            TypeError: an array holds Python objects, or JSON has no form for a value.
        """
        if self.tensors:
            import torch  # only here: a learner without tensors does not wait for it

        for name, tensors in self.tensors.items():
            stream = io.BytesIO()
            torch.save(tensors, stream)
            yield f"{name}.pt", stream.getvalue()
        for name, arrays in self.arrays.items():
            stream = io.BytesIO()
            for key, array in arrays.items():
                if np.asarray(array).dtype.hasobject:
                    raise TypeError(f"{name}.{key} holds Python objects, which only a pickle could store")
            np.savez(stream, **arrays)  # type: ignore[arg-type]
            yield f"{name}.npz", stream.getvalue()
        for name, value in self.values.items():
            yield f"{name}.json", json.dumps(value, indent=1, sort_keys=True).encode()

    @classmethod
    def read(cls, contents: Mapping[str, bytes]) -> Components:
        """Return the components in files; the inverse of `files`.

        Raises:
            ValueError: a file is damaged or would need unpickling.
        """
        components = cls()
        for file_name, data in contents.items():
            name, _, kind = file_name.rpartition(".")
            if kind == "pt":
                components.tensors[name] = archives.weights(data)
            elif kind == "npz":
                components.arrays[name] = archives.arrays(data)
            else:
                components.values[name] = reading.json_value(data, whole=2**128)
        return components
