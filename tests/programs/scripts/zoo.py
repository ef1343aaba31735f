"""rl-zoo3 from its command line: train with keyword arguments for the environment, look at it, film it."""

import subprocess
import sys
import tempfile
from pathlib import Path

import rl_zoo3

ID = "auvbench/Waypoint-v1"
HYPERPARAMETERS = f"""
{ID}:
  n_envs: 2
  n_timesteps: !!float 512
  policy: MlpPolicy
  n_steps: 64
  batch_size: 64
  normalize: true
"""


def run(program: str, *arguments: str) -> None:
    # `train` and `enjoy` have --gym-packages for this, `record_video` does not.
    start = (
        f"import auvbench, runpy; runpy.run_module('rl_zoo3.{program}', run_name='__main__', alter_sys=True)"
    )
    common = ["--algo", "ppo", "--env", ID, "-f", "logs"]
    subprocess.run([sys.executable, "-c", start, *common, *arguments], cwd=folder, check=True)


with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "mine.yml").write_text(HYPERPARAMETERS)
    run(
        "train",
        "--gym-packages",
        "auvbench",
        "--conf-file",
        "mine.yml",
        "-n",
        "512",
        "--eval-freq",
        "-1",
        "--env-kwargs",
        "k:40",
        "frequency:25",
    )
    run("enjoy", "--gym-packages", "auvbench", "-n", "60", "--no-render")
    run("record_video", "-n", "40")
    films = list(Path(folder).glob("logs/**/*.mp4"))
    assert films
    assert films[0].stat().st_size > 1000
print("trained 512 steps; rl-zoo3", rl_zoo3.__version__)
