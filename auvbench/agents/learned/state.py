"""Capture and restore a Stable-Baselines3 learner, so that the restored learner continues bit-identically.

The state is captured at the start of a rollout: at this point, the learner has stored its last transition and updated
its networks, and keeps no state in local variables. `restore` needs a learner whose `learn` is running, because the
learner's creation and the beginning of `learn` draw random numbers and overwrite the state that `restore` sets. A
checkpoint stores the environments separately.

Written for Stable-Baselines3 2.9.2; docs/resume.md lists what `capture` stores.
"""

from __future__ import annotations

import random
import sys
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.base import Components
from auvbench.errors import RunError, TrainingError

Arrays = dict[str, NDArray[Any]]

_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_num_timesteps_at_start")
_OBSERVATIONS = ("_last_obs", "_last_original_obs", "_last_episode_starts")
_GENERATORS = "generators"


def capture(model: BaseAlgorithm) -> Components:
    """Return the state of a learner, except the environments and the replay buffer, which checkpoints store separately."""
    components = Components()
    components.tensors.update(_networks(model))
    components.arrays["learner"] = _learner_arrays(model)
    components.arrays["normalisation"] = _normalisation(normaliser(model))
    components.values["learner"] = {
        "class": type(model).__name__,
        "counters": {name: int(getattr(model, name)) for name in _COUNTERS},
        "elapsed_ns": time.time_ns() - int(model.start_time),
        "logger": _pending(model),
    }
    _capture_generators(components, model)
    return components


def restore(
    model: BaseAlgorithm, components: Components, restarted: NDArray[np.float32] | None = None
) -> None:
    """Restore `components` in a learner whose `learn` is running.

    Args:
        restarted: first observations (n, d) of the episodes that the environments had to restart.

    Raises:
        RunError: the checkpoint belongs to another kind of learner or to other networks.
    """
    values = components.values["learner"]
    if values["class"] != type(model).__name__:
        raise RunError(
            f"the checkpoint is of a {values['class']}, but the run trains a {type(model).__name__}"
        )
    try:
        _restore_networks(model, components.tensors)
    except (RuntimeError, ValueError, KeyError) as error:
        raise RunError(f"the checkpoint does not fit the networks of this configuration: {error}") from error
    _restore_learner_arrays(model, components.arrays["learner"])
    _restore_normalisation(normaliser(model), components.arrays["normalisation"])
    if restarted is not None:
        _begin_episodes(model, restarted)
    for name, value in values["counters"].items():
        setattr(model, name, value)
    if model._total_timesteps:
        model._update_current_progress_remaining(model.num_timesteps, model._total_timesteps)
    # SB3 then logs the rate of steps as if the process had never stopped.
    model.start_time = time.time_ns() - values["elapsed_ns"]
    _restore_pending(model, values["logger"])
    _restore_generators(components, model)


def check_replay(buffer: ReplayBuffer, num_timesteps: int) -> None:
    """Check that only the learner has filled its replay buffer, because checkpoints store the buffer's rows by number.

    Raises:
        TrainingError: other code has also filled the buffer.
    """
    rows = num_timesteps // buffer.n_envs
    if rows % buffer.buffer_size != buffer.pos or (rows >= buffer.buffer_size) != buffer.full:
        raise TrainingError(
            f"the replay buffer is at row {buffer.pos} but {num_timesteps} steps in {buffer.n_envs} "
            f"environments lead to row {rows % buffer.buffer_size}; other code has filled it"
        )


def normaliser(model: BaseAlgorithm) -> VecNormalize:
    normalize = model.get_vec_normalize_env()
    assert isinstance(normalize, VecNormalize)
    return normalize


def _begin_episodes(model: BaseAlgorithm, observation: NDArray[np.float32]) -> None:
    """Let the learner continue from the first observations (n, d) of new episodes."""
    normalize = normaliser(model)
    model._last_episode_starts = np.ones(len(observation), dtype=bool)
    model._last_original_obs = observation.copy()
    model._last_obs = normalize.normalize_obs(observation)
    normalize.old_obs = observation.copy()
    normalize.returns[:] = 0.0


def _networks(model: BaseAlgorithm) -> dict[str, dict[str, Any]]:
    """Return the tensors that SB3's `save` stores: the policy with its target networks, the entropy coefficient, and the optimizers."""
    names, variables = model._get_torch_save_params()
    policy = {
        "modules": {
            name: dict(recursive_getattr(model, name).state_dict())
            for name in names
            if "optimizer" not in name
        },
        "variables": {name: recursive_getattr(model, name).detach() for name in variables},
    }
    optimizers = {name: recursive_getattr(model, name).state_dict() for name in names if "optimizer" in name}
    return {"policy": plain(policy), "optimizers": plain(optimizers)}


def plain(node: Any) -> Any:
    """Return the same values with new containers and interned strings.

    The bytes that `torch.save` writes then depend only on the values. Otherwise they would also depend on which objects
    are shared: a pickle writes a shared object once, and a restored optimizer does not share the same objects as before.
    """
    if isinstance(node, Mapping):
        return {plain(key): plain(value) for key, value in node.items()}
    if isinstance(node, (list, tuple)):
        return type(node)([plain(value) for value in node])
    if isinstance(node, torch.Tensor):
        return node.detach().clone()  # torch would write a view as the whole larger tensor
    return sys.intern(node) if isinstance(node, str) else node


def _restore_networks(model: BaseAlgorithm, tensors: dict[str, dict[str, Any]]) -> None:
    for name, state in tensors["policy"]["modules"].items():
        recursive_getattr(model, name).load_state_dict(state)
    with torch.no_grad():
        for name, value in tensors["policy"]["variables"].items():
            # In place, because the optimizer of the entropy coefficient refers to this tensor.
            recursive_getattr(model, name).copy_(value)
    for name, state in tensors["optimizers"].items():
        recursive_getattr(model, name).load_state_dict(state)


def _learner_arrays(model: BaseAlgorithm) -> Arrays:
    arrays: Arrays = {}
    for name in _OBSERVATIONS:
        value = getattr(model, name)
        if value is not None:
            arrays[name] = np.asarray(value)
    # Arrays keep the types of the numbers, which affect SB3's means.
    infos = list(model.ep_info_buffer or ())
    for key in infos[0] if infos else ():
        arrays[f"ep_info.{key}"] = np.asarray([info[key] for info in infos])
    arrays["ep_success"] = np.asarray(list(model.ep_success_buffer or ()))
    return arrays | {name: tensor.numpy() for name, tensor in _lstm_states(model).items()}


def _lstm_states(model: BaseAlgorithm) -> dict[str, torch.Tensor]:
    """Return hidden and cell states (layers, n, width) that a recurrent learner carries into the next
    rollout, by name.
    """
    states = getattr(model, "_last_lstm_states", None)
    if states is None:
        return {}
    return {
        f"lstm.{network}.{what}": tensor
        for network, pair in states._asdict().items()
        for what, tensor in zip(("hidden", "cell"), pair, strict=True)
    }


def _restore_learner_arrays(model: BaseAlgorithm, arrays: Arrays) -> None:
    for name in _OBSERVATIONS:
        setattr(model, name, arrays[name].copy() if name in arrays else None)
    keys = [name.removeprefix("ep_info.") for name in arrays if name.startswith("ep_info.")]
    rows = zip(*(arrays[f"ep_info.{key}"] for key in keys), strict=True)
    size = model._stats_window_size
    model.ep_info_buffer = deque((dict(zip(keys, row, strict=True)) for row in rows), maxlen=size)
    model.ep_success_buffer = deque(arrays["ep_success"], maxlen=size)
    # In place: SB3 has just created these tensors, and no other object refers to them.
    for name, tensor in _lstm_states(model).items():
        tensor.copy_(torch.from_numpy(arrays[name]))


def _normalisation(normalize: VecNormalize) -> Arrays:
    arrays: Arrays = {"returns": normalize.returns, "old_reward": np.asarray(normalize.old_reward)}
    if hasattr(normalize, "old_obs"):
        arrays["old_obs"] = np.asarray(normalize.old_obs)
    for name, rms in _statistics(normalize).items():
        arrays |= {f"{name}.{key}": np.asarray(getattr(rms, key)) for key in ("mean", "var", "count")}
    return arrays


def _restore_normalisation(normalize: VecNormalize, arrays: Arrays) -> None:
    normalize.returns = arrays["returns"].copy()
    normalize.old_reward = arrays["old_reward"].copy()
    if "old_obs" in arrays:
        normalize.old_obs = arrays["old_obs"].copy()
    for name, rms in _statistics(normalize).items():
        rms.mean = arrays[f"{name}.mean"].copy()
        rms.var = arrays[f"{name}.var"].copy()
        rms.count = float(arrays[f"{name}.count"])


def _statistics(normalize: VecNormalize) -> dict[str, RunningMeanStd]:
    """Return the running statistics by name; statistics of observations only with `norm_obs`."""
    observations = getattr(normalize, "obs_rms", None)
    named = {"obs_rms": observations, "ret_rms": normalize.ret_rms}
    return {name: rms for name, rms in named.items() if isinstance(rms, RunningMeanStd)}


def _pending(model: BaseAlgorithm) -> list[list[Any]]:
    """Return what SB3's logger has recorded but not written: key, type, value, count, excluded outputs."""
    logger = model.logger
    rows = []
    for key, value in logger.name_to_value.items():
        kind = value.dtype.str if isinstance(value, np.generic) else type(value).__name__
        if not isinstance(value, (bool, int, float, str, np.generic)):
            continue  # figures and histograms, which no learner of auvbench records
        plain = value.item() if isinstance(value, np.generic) else value
        rows.append([key, kind, plain, logger.name_to_count.get(key, 0), list(logger.name_to_excluded[key])])
    return rows


def _restore_pending(model: BaseAlgorithm, rows: list[list[Any]]) -> None:
    logger = model.logger
    for table in (logger.name_to_value, logger.name_to_count, logger.name_to_excluded):
        table.clear()
    for key, kind, value, count, excluded in rows:
        numpy_type = kind[:1] in "<>|="
        logger.name_to_value[key] = np.dtype(kind).type(value) if numpy_type else value
        if count:
            logger.name_to_count[key] = count
        logger.name_to_excluded[key] = tuple(excluded)


def _capture_generators(components: Components, model: BaseAlgorithm) -> None:
    """Add the states of the random generators of Python, NumPy, torch and the action space. The action space's generator
    draws the first actions of off-policy learners.
    """
    version, words, gauss = random.getstate()
    kind, keys, position, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002
    components.arrays[_GENERATORS] = {
        "python": np.asarray(words, dtype=np.uint64),
        "numpy": np.asarray(keys, dtype=np.uint32),
        "torch": torch.get_rng_state().numpy(),
    }
    components.values[_GENERATORS] = {
        "python": {"version": version, "gauss": gauss},
        "numpy": {"kind": kind, "position": position, "has_gauss": has_gauss, "cached": float(cached)},
        # PCG64: whole numbers of up to 128 bits
        "action_space": model.action_space.np_random.bit_generator.state,
    }


def _restore_generators(components: Components, model: BaseAlgorithm) -> None:
    """Restore the random generators. Call this last, because the other steps of `restore` may draw random numbers."""
    arrays, values = components.arrays[_GENERATORS], components.values[_GENERATORS]
    python, legacy = values["python"], values["numpy"]
    random.setstate((python["version"], tuple(int(word) for word in arrays["python"]), python["gauss"]))
    np.random.set_state(  # noqa: NPY002
        (legacy["kind"], arrays["numpy"], legacy["position"], legacy["has_gauss"], legacy["cached"])
    )
    torch.set_rng_state(torch.from_numpy(arrays["torch"].copy()))
    model.action_space.np_random.bit_generator.state = values["action_space"]
