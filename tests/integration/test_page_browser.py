"""The page in a real Chromium: it loads, sorts, draws, turns, fits a phone, prints, and asks no network."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.commands.report import main
from auvbench.reporting.figures.looks import colour_of
from tests import page_data
from tests.synthetic import ROBUSTNESS, reconfigure, seal, write_experiment

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None or CHROMEDRIVER is None,
        reason="needs Chromium and its driver (Debian: apt-get install chromium chromium-driver)",
    ),
]
selenium = pytest.importorskip("selenium", reason="needs selenium (pip install auvbench[dev])")

from selenium import webdriver  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.remote.webelement import WebElement  # noqa: E402
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

Driver = webdriver.Chrome


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("browser")
    grid = {"reward_k": (1.0, 40.0), "seeds": (0, 1, 2, 3, 4, 5), "episodes": 40, "train_episodes": 60}
    parts = page_data.parts(folder, **grid)
    parts["ranking"] = replace(parts["ranking"], problems=(page_data.hostile_problem(),))
    path = page_data.write(folder / "report" / "index.html", **parts)
    return path, {**parts, "colours": colour_of(parts["agents"])}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--window-size=1280,900",
        f"--user-data-dir={tmp_path_factory.mktemp('profile')}",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(CHROMEDRIVER)))
    try:
        yield driver
    finally:
        driver.quit()


@pytest.fixture
def opened(browser: Driver, report: tuple[Path, dict[str, Any]]) -> Iterator[Driver]:
    """The page, freshly loaded; afterwards the console must be empty and no address asked for."""
    emulate(browser, 1280, 900)
    browser.get_log("browser")
    browser.get_log("performance")
    load(browser, report[0])
    yield browser
    assert browser.get_log("browser") == []
    assert {address.partition(":")[0] for address in requested(browser)} <= {"file", "data"}


def load(browser: Driver, page: Path) -> None:
    """Open a page and wait until all of it is there: on a busy machine, `get` comes back before."""
    browser.get(page.as_uri())
    whole = "return document.readyState === 'complete' && location.href === arguments[0]"
    WebDriverWait(browser, 60).until(lambda b: b.execute_script(whole, page.as_uri()))


def requested(browser: Driver) -> list[str]:
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [
        m["params"]["request"]["url"]
        for m in messages
        if m["method"] == "Network.requestWillBeSent"
        and not m["params"]["documentURL"].startswith(
            "chrome:"
        )  # the browser's own start page, late on a busy machine
    ]
    sockets = [m["params"]["url"] for m in messages if m["method"] == "Network.webSocketCreated"]
    return sent + sockets


def emulate(browser: Driver, width: int, height: int, scheme: str = "light", mobile: bool = False) -> None:
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    # Without smooth scrolling, so that a click does not meet a page on its way.
    wishes = {"prefers-color-scheme": scheme, "prefers-reduced-motion": "reduce"}
    features = [{"name": name, "value": value} for name, value in wishes.items()]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def find(browser: Driver, selector: str) -> WebElement:
    return browser.find_element(By.CSS_SELECTOR, selector)


def picture(browser: Driver, canvas: str = "scene") -> str:
    """The pixels of a canvas, after whatever it still has to draw."""
    script = """
      const [id, done] = arguments;
      requestAnimationFrame(() => requestAnimationFrame(() => done(document.getElementById(id).toDataURL())));
    """
    return str(browser.execute_async_script(script, canvas))


def colours(browser: Driver, canvas: str = "scene") -> dict[str, int]:
    """How many opaque pixels a canvas has of each colour."""
    script = """
      const canvas = document.getElementById(arguments[0]);
      const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
      copy.drawImage(canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
      const found = {};
      for (let i = 0; i < data.length; i += 4) {
        if (data[i + 3] < 255) continue;
        const name = "#" + [0, 1, 2].map((k) => data[i + k].toString(16).padStart(2, "0")).join("");
        found[name] = (found[name] ?? 0) + 1;
      }
      return found;
    """
    return dict(browser.execute_script(script, canvas))


def column(browser: Driver, table: str, place: int) -> list[str]:
    cells = browser.find_elements(By.CSS_SELECTOR, f"#{table} tbody tr > :nth-child({place})")
    return [str(cell.get_attribute("data-sort") or cell.text) for cell in cells]


def test_page_has_its_parts_in_order(opened: Driver) -> None:
    headings = [h.text for h in opened.find_elements(By.TAG_NAME, "h2")]
    assert headings == [
        "Findings",
        "Claims of the study",
        "Figures",
        "Episodes in 3-D",
        "Appendix",
        "Runs",
        "Problems",
        "Methods",
    ]
    assert "PID" in find(opened, "h1").text
    assert opened.execute_script("return document.querySelectorAll('h1').length") == 1


def test_hostile_text_runs_nothing(opened: Driver) -> None:
    assert page_data.EVIL in find(opened, "#problems").text
    assert opened.execute_script("return window.broken === undefined")


def test_click_on_a_heading_sorts(opened: Driver) -> None:
    headers = opened.find_elements(By.CSS_SELECTOR, "#main-table thead th")
    header = next(h for h in headers if h.text.startswith("success"))
    place = opened.execute_script("return arguments[0].cellIndex", header) + 1
    before = [float(value) for value in column(opened, "main-table", place)]
    header.find_element(By.TAG_NAME, "button").click()
    assert header.get_attribute("aria-sort") == "ascending"
    assert [float(value) for value in column(opened, "main-table", place)] == sorted(before)
    header.find_element(By.TAG_NAME, "button").send_keys(Keys.ENTER)
    assert header.get_attribute("aria-sort") == "descending"
    assert [float(value) for value in column(opened, "main-table", place)] == sorted(before, reverse=True)
    assert len(opened.find_elements(By.CSS_SELECTOR, "#main-table [aria-sort]")) == 1


def test_text_sorts_by_its_numbers_and_missing_values_stay_last(opened: Driver) -> None:
    headers = opened.find_elements(By.CSS_SELECTOR, "#runs-table thead th")
    agent, trained = headers[1], next(h for h in headers if h.text.startswith("train success"))
    place = opened.execute_script("return arguments[0].cellIndex", trained) + 1
    for direction in (1, -1):
        trained.find_element(By.TAG_NAME, "button").click()
        values = opened.execute_script(
            "return [...document.querySelectorAll(`#runs-table tbody tr > :nth-child(${arguments[0]})`)]"
            ".map((cell) => cell.dataset.sort)",
            place,
        )
        assert values[-1] == ""  # the PID was never trained
        found = [direction * float(value) for value in values[:-1]]
        assert found == sorted(found)
    agent.find_element(By.TAG_NAME, "button").click()
    names = column(opened, "runs-table", 2)
    assert names.index("PPO K=1") < names.index("PPO K=40") < names.index("SAC K=1")


def test_filter_of_runs(opened: Driver, report: tuple[Path, dict[str, Any]]) -> None:
    find(opened, "#filter").send_keys("sac k40")
    shown = [
        row for row in opened.find_elements(By.CSS_SELECTOR, "#runs-table tbody tr") if row.is_displayed()
    ]
    assert len(shown) == 6
    assert find(opened, "#filtered").text == f"6 of {len(report[1]['runs'])}"


def test_3d_view_draws_every_chosen_agent_in_its_colour(
    opened: Driver, report: tuple[Path, dict[str, Any]]
) -> None:
    picture(opened)
    found = colours(opened)
    for colour, _, _ in report[1]["colours"].values():
        assert found.get(colour.lower(), 0) > 20, colour
    opened.find_elements(By.CSS_SELECTOR, "#tracks input")[0].click()
    picture(opened)
    first = opened.execute_script(
        "return JSON.parse(document.getElementById('data').textContent).agents[0].colour"
    )
    assert colours(opened).get(first, 0) == 0
    find(opened, '[data-pick="none"]').click()
    picture(opened)
    assert not set(colours(opened)) & {colour for colour, _, _ in report[1]["colours"].values()}


def test_3d_view_shows_another_episode(opened: Driver) -> None:
    first, chart = picture(opened), picture(opened, "distance")
    choice = Select(find(opened, "#episode"))
    assert len(choice.options) == 3
    choice.select_by_index(1)
    assert picture(opened) != first
    assert picture(opened, "distance") != chart
    assert "episode 1" in str(find(opened, "#scene").get_attribute("aria-label"))


def test_3d_view_draws_the_other_vehicles_of_a_team(browser: Driver, tmp_path: Path) -> None:
    seen, names = [], []
    for vehicles in (1, 3):
        parts = page_data.parts(tmp_path / str(vehicles), algorithms=("pid",), seeds=(0,), episodes=5)
        evaluation = parts["runs"][0].directory / "evaluations" / "test"
        with np.load(evaluation / "trajectories.npz") as there:
            arrays = dict(there)
        if vehicles > 1:
            position = arrays["position_nominal_0"]
            arrays["others_nominal_0"] = np.stack([position + 4.0, position - 4.0], 1)
        np.savez(evaluation / "trajectories.npz", **arrays)
        seal(evaluation / "summary.json")
        emulate(browser, 1280, 900)
        load(browser, page_data.write(tmp_path / str(vehicles) / "report" / "index.html", **parts))
        picture(browser)
        seen.append(colours(browser)[colour_of(parts["agents"])["PID"].colour.lower()])
        names.append([option.text for option in Select(find(browser, "#signal")).options])
    assert seen[1] > 1.5 * seen[0]
    assert [name for name in names[1] if name not in names[0]] == ["smallest separation, m"]


def test_the_chart_under_the_3d_view_shows_other_signals(opened: Driver) -> None:
    seen, choice = [picture(opened, "distance")], Select(find(opened, "#signal"))
    names = [option.get_attribute("value") for option in choice.options]
    assert names[:5] == ["distance", "up", "east", "north", "speed"]
    for name in names[1:]:
        choice.select_by_value(str(name))
        seen.append(picture(opened, "distance"))
        assert str(find(opened, "#distance").get_attribute("aria-label")).endswith(" over time")
    assert len({*seen}) == len(names)


def test_3d_view_turns_zooms_and_moves(opened: Driver) -> None:
    canvas = find(opened, "#scene")
    opened.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", canvas)
    seen = [picture(opened)]
    ActionChains(opened).drag_and_drop_by_offset(canvas, 90, 20).perform()
    seen.append(picture(opened))
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, "+", "-", Keys.SHIFT + Keys.ARROW_LEFT):
        canvas.send_keys(key)
        seen.append(picture(opened))
    ActionChains(opened).scroll_from_origin(
        webdriver.common.actions.wheel_input.ScrollOrigin.from_element(canvas), 0, 240
    ).perform()
    seen.append(picture(opened))
    for view in ("top", "south", "east"):
        find(opened, f'[data-view="{view}"]').click()
        seen.append(picture(opened))
    assert all(a != b for a, b in itertools.pairwise(seen))
    canvas.send_keys("0")
    assert picture(opened) == seen[0]


def test_two_fingers_zoom(opened: Driver) -> None:
    canvas = find(opened, "#scene")
    opened.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", canvas)
    before = picture(opened)
    box = opened.execute_script(
        "const r = arguments[0].getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]",
        canvas,
    )
    for kind, gap in (("touchStart", 40), ("touchMove", 70), ("touchMove", 100), ("touchEnd", 0)):
        points = [{"x": box[0] + s * gap, "y": box[1], "id": i} for i, s in enumerate((-1, 1))] if gap else []
        opened.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert picture(opened) != before


def test_time_scrubs_and_plays_to_the_end(opened: Driver) -> None:
    end = picture(opened)
    clock = find(opened, "#clock")
    clock.send_keys(Keys.HOME)
    assert picture(opened) != end
    assert find(opened, "#now").text.startswith("0.0 s of ")
    distances = [float(text) for text in column(opened, "tracks", 4)]
    assert max(distances) - min(distances) < 0.1  # everybody is still at the start
    opened.execute_script("const c = arguments[0]; c.value = 930; c.dispatchEvent(new Event('input'))", clock)
    find(opened, "#play").click()
    WebDriverWait(opened, 30).until(lambda d: find(d, "#clock").get_attribute("value") == "1000")
    WebDriverWait(opened, 30).until(lambda d: find(d, "#play").text == "Play")
    assert picture(opened) == end


def test_figures_are_shown_and_lead_to_their_files(
    opened: Driver, report: tuple[Path, dict[str, Any]]
) -> None:
    sizes = opened.execute_script(
        "return [...document.querySelectorAll('figure img')].map((i) => i.naturalWidth)"
    )
    assert len(sizes) == 2
    assert min(sizes) > 100
    link = find(opened, "figure a").get_attribute("href")
    assert link == report[1]["figures"][0].svg.as_uri()


def test_numbers_lead_to_their_runs(opened: Driver) -> None:
    link = find(opened, "#main-table tbody a[href^='#run-']")
    link.click()
    target = opened.execute_script("return document.querySelector(':target')?.closest('table').id")
    assert target == "runs-table"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 768, 1280])
def test_nothing_hangs_over_the_side(
    browser: Driver, report: tuple[Path, dict[str, Any]], width: int, scheme: str
) -> None:
    emulate(browser, width, 740, scheme, mobile=width < 768)
    load(browser, report[0])
    for part in browser.find_elements(By.CSS_SELECTOR, "details"):
        browser.execute_script("arguments[0].open = true", part)
    inner, scrolled = browser.execute_script("return [innerWidth, document.documentElement.scrollWidth]")
    assert inner == width
    assert scrolled <= width
    background = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert (sum(int(part) for part in background.strip("rgb()").split(",")) > 384) == (scheme == "light")
    assert browser.get_log("browser") == []


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of nine agents under twenty conditions, with all its figures."""
    folder = tmp_path_factory.mktemp("large") / "grid"
    grid: dict[str, Any] = {"algorithms": ("ppo", "sac"), "reward_k": (1, 40), "frequencies": (10, 25)}
    write_experiment(
        folder, **grid, seeds=(0, 1), episodes=10, train_episodes=60, protocols={"robustness": ROBUSTNESS}
    )
    write_experiment(folder, algorithms=("pid",), episodes=10, protocols={"robustness": ROBUSTNESS})
    for run in list(folder.glob("sac-k1-*")):  # labels as long as varied configurations make them
        reconfigure(run, disturbance__name="moderate", train__total_steps=300_000)
    assert main([str(folder), "--protocol", "robustness", "--baseline", "pid", "--format", "html"]) == 0
    return folder / "report" / "index.html"


def unfolded(browser: Driver, page: Path, width: int) -> None:
    emulate(browser, width, 900, mobile=width < 768)
    load(browser, page)
    browser.execute_script("for (const part of document.querySelectorAll('details.more')) part.open = true")
    # What is observed is told after a frame.
    browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")


@pytest.mark.parametrize("width", [1400, 1900])
def test_on_a_wide_screen_only_tables_of_many_columns_are_moved_sideways(
    browser: Driver, large: Path, width: int
) -> None:
    unfolded(browser, large, width)
    cut = """
      return [...document.querySelectorAll('.scroll')].filter((part) => part.scrollWidth > part.clientWidth)
        .map((part) => part.querySelector('table')?.id);
    """
    assert set(browser.execute_script(cut)) <= {"conditions-table", "further-table"}


def test_a_phone_shows_figures_large_enough_to_read_and_says_where_there_is_more(
    browser: Driver, large: Path
) -> None:
    unfolded(browser, large, 390)
    scale = "return [...document.querySelectorAll('figure img')].map((i) => i.clientWidth / i.width)"
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    scales = browser.execute_script(scale.replace("i.width", "i.getAttribute('width')"))
    assert len(scales) >= 7
    assert min(scales) >= 0.49  # nine-point text is then nine pixels high
    clipped = "return document.getElementById('main-table').closest('.scroll').classList.contains('clipped')"
    assert browser.execute_script(clipped)
    browser.execute_script("document.getElementById('main-table').closest('.scroll').scrollLeft = 1e4")
    browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    assert not browser.execute_script(clipped)


def test_print_leaves_room_for_several_figures_on_a_page(browser: Driver, large: Path) -> None:
    unfolded(browser, large, 703)  # px of an A4 page within its margins
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    heights = browser.execute_script(
        "return [...document.querySelectorAll('figure img')].map((i) => i.getBoundingClientRect().height)"
    )
    breaks = browser.execute_script("return getComputedStyle(document.getElementById('runs')).breakBefore")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    millimetre = 96 / 25.4
    assert max(heights) <= 75 * millimetre  # three of the tallest, with their captions
    assert breaks == "auto"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_background(
    browser: Driver, report: tuple[Path, dict[str, Any]], scheme: str
) -> None:
    """WCAG 2.2, 1.4.3: a contrast of at least 4.5 for every text of the page."""
    emulate(browser, 1280, 900, scheme)
    load(browser, report[0])
    script = """
      const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
      const light = (c) => c.slice(0, 3).map((v) => v / 255)
        .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
      const behind = (element) => {
        for (let e = element; e; e = e.parentElement) {
          const colour = rgb(getComputedStyle(e).backgroundColor);
          if (colour.length < 4 || colour[3] > 0) return colour;
        }
      };
      const poor = [];
      const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
      while (walker.nextNode()) {
        const element = walker.currentNode.parentElement;
        if (!walker.currentNode.data.trim() || !element.checkVisibility() || element.matches("script")) continue;
        const pair = [rgb(getComputedStyle(element).color), behind(element)].map(light).sort((a, b) => a - b);
        const ratio = (pair[1] + 0.05) / (pair[0] + 0.05);
        if (ratio < 4.5) poor.push(`${ratio.toFixed(2)} ${walker.currentNode.data.trim()}`);
      }
      return poor;
    """
    assert browser.execute_script(script) == []


def test_print_is_a4_and_leaves_the_screen_as_it_was(opened: Driver) -> None:
    before = picture(opened)
    printed = opened.execute_cdp_cmd("Page.printToPDF", {"printBackground": True, "preferCSSPageSize": True})
    pdf = base64.b64decode(printed["data"])
    assert pdf.startswith(b"%PDF")
    assert b"/MediaBox [0 0 595" in pdf or b"/MediaBox [0 0 594" in pdf
    assert picture(opened) == before
    assert not find(opened, "details.more").get_attribute("open")
