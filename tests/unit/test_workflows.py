"""What GitHub Actions and the Dockerfile may run: pinned by hash, with time limits, publishing apart from the tests."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def jobs(path: Path) -> dict[str, dict[str, Any]]:
    found = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_every_action_is_pinned_by_the_hash_of_a_commit_and_names_its_version(path: Path) -> None:
    used = re.findall(r"uses: (.*)", path.read_text(encoding="utf-8"))
    assert used
    for line in used:
        assert line.startswith("./") or re.fullmatch(r"[\w.-]+/[\w.-]+@[0-9a-f]{40} # v\d+(\.\d+)+", line), (
            line
        )


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_every_job_has_a_time_limit(path: Path) -> None:
    for name, job in jobs(path).items():
        assert job.get("uses") or 0 < job["timeout-minutes"] <= 180, name


def test_publishing_is_a_job_of_its_own_that_waits_for_the_tests() -> None:
    found = jobs(ROOT / ".github" / "workflows" / "release.yml")
    assert set(found["publish"]["needs"]) == {"test", "build"}
    assert found["test"]["uses"] == "./.github/workflows/test.yml"
    assert all("run" not in step for step in found["publish"]["steps"])
    # `on` is a boolean in YAML 1.1.
    assert "workflow_call" in yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text())[True]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_only_the_jobs_that_publish_may_identify_themselves(path: Path) -> None:
    assert yaml.safe_load(path.read_text(encoding="utf-8"))["permissions"] == {"contents": "read"}
    allowed = {name for name, job in jobs(path).items() if "id-token" in job.get("permissions", {})}
    assert allowed == {"release.yml": {"publish"}, "docs.yml": {"deploy"}, "test.yml": set()}[path.name]


def test_the_image_is_that_of_a_digest_and_takes_files_by_their_hashes() -> None:
    assert re.search(r"^ARG PYTHON=python:3\.\d+-slim@sha256:[0-9a-f]{64}$", DOCKERFILE, re.M)
    assert set(re.findall(r"^FROM (\S+)", DOCKERFILE, re.M)) == {"${PYTHON}"}
    locks = re.findall(r"--require-hashes .*-r (\S+)", DOCKERFILE)
    assert locks == ["requirements-build.lock", "requirements.lock"]
    copied = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert {f"!{lock}" for lock in locks} <= set(copied)


def test_the_image_brings_its_compiled_code_along() -> None:
    (folder,) = re.findall(r"^ENV .*\bNUMBA_CACHE_DIR=(\S+)", DOCKERFILE, re.M)
    build, final = re.split(r"^FROM ", DOCKERFILE, flags=re.M)[1:]
    (step,) = re.findall(rf"NUMBA_CACHE_DIR={folder} /opt/auvbench/bin/python -c \\\n +'(.*)'", build)
    assert step in (ROOT / "Makefile").read_text(encoding="utf-8")
    assert f"chmod -R a+rwX {folder}" in build
    assert f"COPY --from=build {folder} {folder}\n" in final


@pytest.mark.parametrize(("user", "expected"), [("0", ["apt-get"] * 2), ("1000", ["sudo -n apt-get"] * 2)])
def test_chromium_is_installed_with_sudo_where_that_is_needed(
    tmp_path: Path, user: str, expected: list[str]
) -> None:
    log = tmp_path / "log"
    for name, line in (
        ("id", f"echo {user}"),
        ("sudo", f'echo "sudo $*" >> {log}'),
        ("apt-get", f'echo "apt-get $*" >> {log}'),
    ):
        stub = tmp_path / name
        stub.write_text(f"#!/bin/bash\n{line}\n")
        stub.chmod(0o755)
    subprocess.run(
        ["/bin/bash", ROOT / ".ci/chromium"], env={**os.environ, "PATH": str(tmp_path)}, check=True
    )
    lines = log.read_text().splitlines()
    assert [line.split(" update")[0].split(" install")[0] for line in lines] == expected
    assert lines[1].endswith("chromium chromium-driver")


def test_a_machine_with_chromium_installs_nothing(tmp_path: Path) -> None:
    for name in ("chromium", "apt-get"):
        (tmp_path / name).write_text("#!/bin/bash\nexit 1\n")
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        ["/bin/bash", ROOT / ".ci/chromium"],
        env={"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
