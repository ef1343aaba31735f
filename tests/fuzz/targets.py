"""What is made at random, and the commands that meet it."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import json
import random
import shutil
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from hypothesis import strategies as st

from auvbench.runs import integrity
from tests import synthetic
from tests.fuzz.harness import judge

NASTY = (
    "", " ", "null", "true", "nan", "inf", "-inf", "-1", "0", "1e999", "1e12", "1_0", "0x1f", "1.5", "9" * 30,
    "[]", "{}", "[1,2]", "[[[[1]]]]", "{a: 1}", "[null]", "[nan,inf]", "${nope}", "${oc.env:NOPE}", "${seed}", "${",
    "$", "${oc.decode:x}", "???", "???.x", "1,2", "choice(1,2)", "range(0,3)", "range(0,1e9)", "interval(0,1)",
    "glob(*)", "sort(3,1)", "shuffle(1)", "int(x)", "'", '"', "\\", "a=b", "=", "~", "!", "@x", "a@b", "../../x",
    "/dev/null", "/", ".", "ppo,sac", "bluerov2", "rexrov", "[/b]", "[red]x", "\x1b[31mred", "\u202eabc", "ä", "日本",
    "x" * 3000, "[" * 300, "(" * 300, "\t", "a\nb", "$x^2$", "=1+1", "None", "!!python/object:os.system", "*", "&a",
)  # fmt: skip
"""texts that somewhere mean something"""

FLAGS = (
    "-m",
    "--cfg",
    "job",
    "--x",
)

EXTREMES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2**63, -(2**63), 10**30, 0.0, -0.0, 1.5, 1e-300, 1e12, -1e12, 1e300, float("inf"),
    float("-inf"), float("nan"), "", "x", [], {}, [1], [None], {"a": 1}, [[1, 2], [3]], [1e12] * 6,
)  # fmt: skip


def texts() -> st.SearchStrategy[str]:
    plain = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=30)
    return st.one_of(st.sampled_from(NASTY), plain)


def values() -> st.SearchStrategy[Any]:
    leaf = st.one_of(st.sampled_from(EXTREMES), texts(), st.integers(), st.floats())
    return st.one_of(leaf, st.lists(leaf, max_size=4), st.dictionaries(texts(), leaf, max_size=3))


@cache
def keys() -> tuple[str, ...]:
    """Dotted keys of the configurations, and of Hydra's own."""
    from omegaconf import OmegaConf

    from auvbench.config.compose import compose
    from auvbench.config.overrides import leaves

    found = [
        *leaves(OmegaConf.to_container(compose("train"))),
        *leaves(OmegaConf.to_container(compose("evaluate"))),
    ]
    vehicle = [key for key in found if key.startswith("vehicle.")]
    rest = [key for key in found if not key.startswith("vehicle.")]
    return (
        *dict.fromkeys([*rest, *vehicle[::20]]),
        "hydra.mode",
        "hydra.sweeper.params.seed",
        "hydra.verbose",
        "nope",
        "a.b",
    )


@st.composite
def overrides(draw: st.DrawFn) -> list[str]:
    """A command line's words after the command."""
    found = []
    for _ in range(draw(st.integers(1, 3))):
        if draw(st.integers(0, 9)) == 0:
            found.append(draw(st.sampled_from(FLAGS)))
            continue
        key = draw(st.one_of(st.sampled_from(keys()), st.sampled_from(keys()), texts()))
        prefix = draw(st.sampled_from(("", "", "", "", "+", "++", "~")))
        found.append(f"{prefix}{key}={draw(texts())}" if draw(st.integers(0, 19)) else f"{prefix}{key}")
    return [word for word in found if "\0" not in word]


def command_line(folder: Path, words: list[str], choice: int) -> None:
    command = (
        ["train"],
        ["train", "-m"],
        ["simulate"],
        ["evaluate", str(folder / "none")],
        ["train", "--cfg", "job"],
    )[choice % 5]
    judge([*command, *words])


@cache
def _experiment(folder: str) -> Path:
    root = Path(folder) / "experiment"
    synthetic.write_experiment(root, algorithms=("pid", "ppo"), seeds=(0,), episodes=8, train_episodes=12)
    return root


@cache
def _original(folder: str) -> Path:
    return _experiment(folder)


def fresh(folder: Path) -> Path:
    """A copy of a small experiment, PPO's run first; returns the experiment."""
    copy_ = folder / "x"
    shutil.rmtree(copy_, ignore_errors=True)
    shutil.copytree(_original(str(folder)), copy_)
    return copy_


def runs_of(experiment: Path) -> list[Path]:
    return sorted((path.parent for path in experiment.glob("*/manifest.json")), reverse=True)


def _paths(node: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [at] if at else []
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in items:
        found += _paths(child, (*at, key))
    return found


def mutated(node: Any, where: int, value: Any, how: int) -> Any:
    """A copy with one entry replaced, removed or doubled."""
    node = copy.deepcopy(node)
    paths = _paths(node)
    *above, last = paths[where % len(paths)]
    holder = node
    for key in above:
        holder = holder[key]
    if how % 8 == 0 and isinstance(holder, dict):
        del holder[last]
    elif how % 8 == 1 and isinstance(holder, dict):
        holder[f"{last}x"] = value
    else:
        holder[last] = value
    return node


def damaged(data: bytes, seed: int, how: int) -> bytes:
    """Some bytes changed, cut or doubled."""
    rng = random.Random(seed)
    changed = bytearray(data)
    if how % 4 == 0:
        return bytes(changed[: rng.randrange(len(changed) + 1)])
    if how % 4 == 1:
        at = rng.randrange(len(changed) + 1)
        return bytes(changed[:at]) + rng.randbytes(rng.randrange(20)) + bytes(changed[at:])
    for _ in range(rng.randrange(1, 6)):
        if changed:
            changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def every_reader(experiment: Path, *, heavy: bool) -> None:
    """All commands that read runs."""
    run = runs_of(experiment)
    judge(["runs", str(experiment)])
    judge(["runs", str(experiment), "--json"])
    judge(
        [
            "report",
            str(experiment),
            "--no-figures",
            "--format",
            "terminal,md,csv,tex" + (",html" if heavy else ""),
        ]
    )
    for path in run[:1]:
        judge(["evaluate", str(path), "--workers", "1"])
        judge(["resume", str(path)])
        if heavy:
            judge(["replay", str(path)])
    if heavy:
        study = experiment.with_name("published")
        shutil.rmtree(study, ignore_errors=True)
        judge(["publish", str(experiment), "--to", str(study), "--pictures", ""])


def _dump(path: Path, value: Any, seal: int) -> None:
    if seal % 3:
        value = integrity.sealed(value) if isinstance(value, dict) and _sealable(value) else value
    path.write_text(json.dumps(value), encoding="utf-8")


def _sealable(value: Any) -> bool:
    try:
        integrity.sealed(value)
    except (TypeError, ValueError):
        return False
    return True


def manifest(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    experiment = fresh(folder)
    path = runs_of(experiment)[0] / "manifest.json"
    if how % 5 == 4:
        path.write_bytes(damaged(path.read_bytes(), seed, how))
    else:
        _dump(path, mutated(json.loads(path.read_text()), where, value, how), seed)
    every_reader(experiment, heavy=seed % 4 == 0)


def summary(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    experiment = fresh(folder)
    path = next(iter(sorted(runs_of(experiment)[0].glob("evaluations/*/summary.json"))))
    if how % 5 == 4:
        path.write_bytes(damaged(path.read_bytes(), seed, how))
    else:
        _dump(path, mutated(json.loads(path.read_text()), where, value, how), seed)
    every_reader(experiment, heavy=seed % 4 == 0)


def table(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    """episodes.csv of a test or of a training, and the paths, with digests that fit or do not."""
    experiment = fresh(folder)
    run = runs_of(experiment)[0]
    path = sorted([*run.glob("evaluations/*/*.[cn][sp][vz]"), *run.glob("train/*.csv")])[where % 3]
    if how % 2 and path.suffix == ".csv":
        lines = path.read_text().split("\n")
        line = where % max(1, len(lines) - 1)
        cells = lines[line].split(",")
        cells[seed % len(cells)] = str(value)
        lines[line] = ",".join(cells)
        path.write_text("\n".join(lines), encoding="utf-8", errors="replace")
    else:
        path.write_bytes(damaged(path.read_bytes(), seed, how))
    holder = path.parent / "summary.json" if path.parent.name != "train" else run / "manifest.json"
    if seed % 2:  # somebody who wants to deceive
        held = json.loads(holder.read_text())
        if isinstance(files := held.get("files"), dict):
            name = path.name if holder.name == "summary.json" else "train/episodes.csv"
            files[name] = integrity.entry(path.read_bytes())
            held = integrity.sealed(held)
        holder.write_text(json.dumps(held))
    every_reader(experiment, heavy=seed % 3 == 0)


def configuration(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    experiment = fresh(folder)
    path = runs_of(experiment)[0] / "config.yaml"
    if how % 5 == 4:
        path.write_bytes(damaged(path.read_bytes(), seed, how))
    else:
        path.write_text(yaml.safe_dump(mutated(yaml.safe_load(path.read_text()), where, value, how)))
    if seed % 2:  # the folder's name and the manifest's id agree with it
        _agree(path.parent)
    every_reader(experiment, heavy=seed % 4 == 0)


DEEP = ("- " * 100_000, "[" * 100_000, "{a: " * 100_000, "? " * 100_000)
BEFORE = ("", "x:\r", "x:\x85", "x:\u2028", "\ufeffx:\r\n", "x:\n ")


def nested(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    """A configuration that PyYAML's loader would fall over, among sound runs."""
    experiment = fresh(folder)
    text = BEFORE[where % len(BEFORE)] + DEEP[how % len(DEEP)]
    path = runs_of(experiment)[0] / "config.yaml"
    path.write_bytes(text.encode("utf-16" if seed % 4 == 0 else "utf-8"))
    every_reader(experiment, heavy=seed % 8 == 1)


PLACES = (
    "/",
    "..",
    "../",
    "../../outside",
    "../outside",
    "a/../../../outside",
    "link/outside",
    "link",
    "",
    ".",
    "\0",
)


def checkpoint(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    """The manifest of a checkpoint with a seal that fits: what is copied from it stays inside the two runs."""
    from auvbench.agents.base import Components
    from auvbench.errors import RunError, TrainingError
    from auvbench.training.checkpoint.extending import seed as copy_checkpoint
    from auvbench.training.checkpoint.logs import GrowingLog
    from auvbench.training.checkpoint.store import CheckpointStore

    root = folder / "checkpointed"
    shutil.rmtree(root, ignore_errors=True)
    run, outside = root / "x" / "run", root / "outside"
    (run / "train").mkdir(parents=True)
    outside.write_text("untouched")
    (run / "train" / "episodes.csv").write_text("a\n")
    (run / "link").symlink_to(root)
    marks = {"train/episodes.csv": GrowingLog(run / "train" / "episodes.csv").mark()}
    store = CheckpointStore(run)
    path = store.save(5, Components(values={"counters": {"step": 5}}), logs=marks) / "manifest.json"
    content = json.loads(path.read_text())
    if how % 2:
        name = (*PLACES, str(outside), str(value))[where % (len(PLACES) + 2)]
        content["logs" if seed % 2 else "files"][name] = {"bytes": 0, "sha256": hashlib.sha256().hexdigest()}
    else:
        content = mutated(content, where, value, how // 2)
    _dump(path, content, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with contextlib.suppress(RunError, TrainingError):
            found = store.peek()
            if found is not None:
                (run / "link").unlink()
                copy_checkpoint(run, found, root / "x" / "longer")
    assert outside.read_text() == "untouched"
    assert {p.name for p in root.iterdir()} == {"x", "outside"}


def _agree(run: Path) -> None:
    from auvbench.runs import identity

    try:
        name = identity.run_id(yaml.safe_load((run / "config.yaml").read_text()))
        if not name.isprintable() or "/" in name or len(name.encode()) > 200:
            return
        held = {**json.loads((run / "manifest.json").read_text()), "id": name}
        (run / "manifest.json").write_text(json.dumps(integrity.sealed(held)))
        run.rename(run.with_name(name))
    except Exception:  # it has no id
        return


@cache
def _sheets() -> tuple[dict[str, Any], ...]:
    from auvbench.vehicles.reader import read, sheet_names

    return tuple(read(name).data for name in sheet_names())


def sheet(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    path = folder / "conf" / "vehicle" / "fuzzed.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    originals = _sheets()
    text = yaml.safe_dump(mutated(originals[seed % len(originals)], where, value, how))
    path.write_bytes(damaged(text.encode(), seed, how) if how % 7 == 6 else text.encode())
    judge(["vehicles", "fuzzed"])
    judge(["vehicles", str(path)])
    judge(["vehicles"])
    judge(["simulate", "vehicle=fuzzed"])
    judge(["train", "vehicle=fuzzed", f"output={folder}"])


def analysis(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    from importlib import resources

    text = (resources.files("auvbench.conf") / "report.yaml").read_text(encoding="utf-8")
    experiment = folder / "for-analyses"
    if not experiment.exists():
        shutil.copytree(_original(str(folder)), experiment)
    whole = {"measure": "success_rate", "report": yaml.safe_load(text)}
    made = yaml.safe_dump(mutated(whole, where, value, how)).encode()
    path = experiment / "analysis.yaml"
    path.write_bytes(damaged(yaml.safe_dump(whole).encode(), seed, how) if how % 5 == 4 else made)
    judge(
        [
            "report",
            str(experiment),
            "--no-figures",
            "--out",
            str(folder / "analyses-out"),
        ]
    )


@cache
def _study(folder: str) -> Path:
    study = Path(folder) / "sound"
    judge(["publish", str(_experiment(folder)), "--to", str(study), "--pictures", ""])
    return study


def study(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    """A published study with one table changed; the digests fit, or do not."""
    import pyarrow as pa
    from pyarrow import parquet

    from auvbench.analysis import archive

    copy_ = folder / "study"
    shutil.rmtree(copy_, ignore_errors=True)
    shutil.copytree(_study(str(folder)), copy_)
    others = (archive.EPISODES, archive.TRAJECTORIES)
    path = copy_ / (archive.RUNS, *others)[where % 3]
    if how % 3 == 0:
        path.write_bytes(damaged(path.read_bytes(), seed, how))
    else:
        table = parquet.ParquetFile(path).read().replace_schema_metadata(None)
        at = where // 3 % table.num_columns
        name, column = table.column_names[at], table.column(at).to_pylist()
        with contextlib.suppress(pa.ArrowException, OverflowError, TypeError, UnicodeEncodeError):
            values = [value] * len(column) if how % 3 == 1 else [value, *column[1:]]
            table = table.set_column(at, name, pa.array(values))
        if how % 5 == 4:
            table = table.append_column(name, table.column(at))
        with contextlib.suppress(pa.ArrowException):  # what Parquet has no form for
            parquet.write_table(table, path, store_schema=False)
    with contextlib.suppress(pa.ArrowException, OSError, ValueError, TypeError, AttributeError):
        table = parquet.ParquetFile(copy_ / archive.RUNS).read()
        files = {each: (copy_ / each).read_bytes() for each in others}
        notes = archive.note(table.replace_schema_metadata(None).to_pandas(), files)
        parquet.write_table(table.replace_schema_metadata(notes), copy_ / archive.RUNS, store_schema=False)
    judge(["report", str(copy_), "--no-figures", "--format", "terminal,md,csv,tex"])
    if seed % 4 == 0:
        judge(["publish", str(copy_), "--to", str(folder / "again"), "--pictures", "success_over_time"])


def policy(folder: Path, where: int, value: Any, how: int, seed: int) -> None:
    """An ONNX file with bytes changed or an operator of another kind: a policy, or one line."""
    import numpy as np

    from auvbench.policies import exported
    from tests import hostile_onnx, onnx_files

    kinds = (
        "Div",
        "Mod",
        "Pow",
        "Reshape",
        "Gather",
        "Tile",
        "Expand",
        "Slice",
        "Pad",
        "TopK",
        "OneHot",
        "Range",
    )
    kind = kinds[where % len(kinds)]
    made = hostile_onnx.sized(kind, [seed, how % 7, -where][: 1 + how % 3], *["h"][: seed % 2])
    data = (onnx_files.model() if how % 2 else made).SerializeToString()
    data = damaged(data, seed, how) if seed % 3 else data
    with contextlib.suppress(exported.PolicyError):
        exported.Policy(data, "fuzzed.onnx", observations=10, actions=6, seconds=2).act(np.ones((3, 10)))


FILES: dict[str, Callable[[Path, int, Any, int, int], None]] = {
    "manifests": manifest,
    "summaries": summary,
    "tables": table,
    "configurations": configuration,
    "nested configurations": nested,
    "checkpoints": checkpoint,
    "sheets": sheet,
    "analyses": analysis,
    "studies": study,
    "policies": policy,
}

FLOATS_ONLY = ("sheets",)


def wholes() -> st.SearchStrategy[int]:
    return st.integers(0, 10**6)
