"""The profile with which Fast DDS finds its peers at once: ours, unless the user has one."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from auvbench.integrations.ros2 import middleware
from tests import dds

pytestmark = dds.needs_ros

NAMED = f"""
import os
from auvbench.integrations.ros2.middleware import load
load()
print(os.environ.get({middleware.PROFILES!r}))
"""


def chosen(folder, **variables):
    environment = {k: v for k, v in os.environ.items() if k != middleware.PROFILES} | variables
    done = subprocess.run(
        [sys.executable, "-c", NAMED], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_ours_where_there_is_no_other(tmp_path):
    assert chosen(tmp_path) == str(middleware.DISCOVERY)


@pytest.mark.slow
def test_the_users_own_stays(tmp_path):
    assert chosen(tmp_path, **{middleware.PROFILES: "/mine.xml"}) == "/mine.xml"


@pytest.mark.slow
def test_the_working_directory_has_no_say(tmp_path):
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text("<dds/>")
    assert chosen(tmp_path) == str(middleware.DISCOVERY)


@pytest.mark.parametrize(("tag", "value"), [("count", "50"), ("leaseAnnouncement", None)])
def test_it_is_what_the_documentation_says(tag, value):
    (found,) = ElementTree.parse(middleware.DISCOVERY).getroot().iter(f"{{http://www.eprosima.com}}{tag}")
    assert value is None or found.text == value
    if value is None:
        assert [part.text for part in found] == ["1", "0"]


def test_a_domain_in_which_any_process_lives_is_occupied():
    with dds.domain() as number:
        assert not dds.occupied(number)
        session = middleware.Session()
        session.node("lodger")
        assert dds.occupied(number)
        session.close()
