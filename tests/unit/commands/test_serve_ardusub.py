"""`auvbench serve --face ardusub` as a user types it."""

import re
import signal
import socket
import subprocess
import sys

import pytest

from auvbench.cli import main
from tests.ardusub_peer import NEUTRAL, Peer
from tests.waiting import LIMIT

ARDUSUB = ("serve", "--face", "ardusub")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--face", "ardusu"], "did you mean 'ardusub'"),
        (["--face", "ardusub", "--pace", "2"], "--pace: needs --face ros2"),
        (["--port", "9003"], "--port: needs --face ardusub"),
        (["--give-up", "3"], "--give-up: needs --face ardusub"),
        (["--face", "ardusub", "algo=pid"], "serve has no such key"),
        (["--face", "ardusub", "--port", "0"], "from 1 to 65535"),
        (["--face", "ardusub", "--address", ""], "must be an IPv4 address"),
        (["--face", "ardusub", "--port", "65530", "--vehicles", "2"], "at most 65525"),
        (["--face", "ardusub", "--vehicles", "0"], "from 1 to 1000"),
        (["--face", "ardusub", "--battery", "nan"], "from 6 to 24"),
        (["--face", "ardusub", "--give-up", "0"], "from 0.001"),
        (["--face", "ardusub", "--thrust", "t100"], "did you mean 't200'"),
        (["--face", "ardusub", "--motors=thruster1"], "each thruster of bluerov2_2026 once"),
        (["--face", "ardusub", "vehicle=lrauv"], "rudder"),
        (["--face", "ardusub", "vehicle=rexrov"], "--motors=thruster0"),
        (["--face", "ardusub", "simulator=gazebo"], "simulator=fossen"),
        (["--face", "ardusub", "disturbance=moderate"], "disturbance.delay"),
        (["--face", "ardusub", "task.start=[0,0,1]"], "depth limits"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_wrong_flag_gets_one_line(arguments, words, capsys):
    assert main(["serve", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert "\n" not in error


def test_a_taken_port_gets_one_line(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        assert main([*ARDUSUB, "--port", str(port)]) == 2
    assert f"UDP port {port} is taken" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_asked_to_stop(number):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "auvbench", *ARDUSUB, "--port", str(port), "vehicle=bluerov2_heavy"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert re.search(
                rf"127\.0\.0\.1:{port}: FRAME_CONFIG 2 .*channels 1 to 8", process.stdout.readline()
            )
            with Peer(port, rate=1200) as peer:
                replies = [peer.step((1500,) * 4 + (1400,) * 4 + NEUTRAL[8:]) for _ in range(1200)]
            assert replies[-1]["timestamp"] == pytest.approx(1.0)
            process.send_signal(number)
            out, error = process.communicate(timeout=LIMIT)
        finally:
            process.kill()
    assert process.returncode == 0
    assert out.splitlines()[-1] == "auvbench: stopped"
    assert error.replace("auvbench: compiling the simulator", "").count("\n") <= 1
