"""The page of a recording in a real browser: served, and saved as one file."""

import re

import pytest

from chromium import browser, needs_browser
from page_client import wait_until
from page_messages import power_states, recorded, registers
from robot_energy_report.page.access import page_access
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.saved_page import saved_page
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_server import PageServer

pytestmark = [needs_browser, pytest.mark.filterwarnings("ignore::ResourceWarning")]
READY = "document.querySelector('#flow rect') && document.querySelector('#lines path')"
SETTINGS = PageSettings(price_per_kwh=0.3, co2_kg_per_kwh=0.4)


@pytest.fixture(scope="module")
def window():
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def recording():
    return recorded(settings=SETTINGS)


@pytest.fixture(scope="module")
def url(recording):
    server = PageServer(recording[0].hub, page_access())
    yield server.url
    server.close()


@pytest.fixture(scope="module")
def saved(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "page.html"
    path.write_text(saved_page(recording[0].state()), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(params=["url", "saved"])
def opened(request, window):
    """The page, served or saved, ready and without complaint of the browser."""
    address = request.getfixturevalue(request.param)
    window.dark(False)
    window.complaints()
    window.open(address)
    window.wait(READY, "the figures")
    return window


def test_the_page_needs_nothing_but_its_server(opened, url):
    assert opened.complaints() == []
    assert all(name.startswith((url, "data:")) for name in opened.requests())
    assert "kr16_cold" in opened.text("title")


def test_energy_and_mean_power_are_of_the_same_time(window, recording, tmp_path):
    """A live page that is saved has power states that the registers have not counted yet."""
    state = recording[0].state()
    state["robots"][0]["headline"]["energy"] = 3600.0
    state["robots"][0]["registers"]["observed_time"] = 10.0
    path = tmp_path / "page.html"
    path.write_text(saved_page(state), encoding="utf-8")
    window.open(path.as_uri())
    window.wait(READY, "the figures")
    assert window.text("energy") == "1.000 Wh"
    assert window.text("power") == "360 W"
    assert window.text("power-note") == "predicted, over 10.0 s"
    assert "Wh" not in window.text("lines-note")


def test_a_prediction_that_is_not_compared_yet_is_explained(window, recording, tmp_path):
    state = recording[0].state()
    path = tmp_path / "page.html"
    for value, explained in ((3600.0, False), (None, True)):
        state["robots"][0]["registers"]["predicted_energy_at_meter"] = value
        path.write_text(saved_page(state), encoding="utf-8")
        window.open(path.as_uri())
        window.wait(READY, "the figures")
        assert ("a meter that lags" in window.text("registers-note")) == explained


@pytest.mark.parametrize("mode", ["energy_flow", "flow"])
def test_the_flow_balances_as_it_is_drawn(opened, mode):
    opened.click(f"[data-flow={mode}]")
    opened.wait(f"document.querySelector('[data-flow={mode}]').ariaPressed === 'true'", mode)
    nodes = opened.flow_nodes()
    assert {"grid", "bus", "axis0", "friction", "cabinet"} <= {node["id"] for node in nodes}
    for node in nodes:
        if node["inner"]:
            assert node["into"] == node["out"], node
    drawn = {node["id"]: node for node in nodes}
    net = int(opened.run("return document.getElementById('flow').dataset.net"))
    assert drawn["grid"]["out"] == net
    sources = sum(node["out"] for node in nodes if not node["into"])
    sinks = sum(node["into"] for node in nodes if not node["out"])
    assert sources == sinks
    # The digits that are shown, not only the units behind them.
    texts = [(source, target, float(size.split()[0])) for source, target, size, _ in opened.flows()]
    into_bus = sum(size for _, target, size in texts if target == "DC bus")
    out_of_bus = sum(size for source, _, size in texts if source == "DC bus")
    assert into_bus == pytest.approx(out_of_bus, abs=1e-9)


def test_the_table_is_the_registers(opened, recording):
    account = recording[1].account
    shown = opened.values("registers")
    assert float(shown["from the grid, predicted"][0]) == account.registers.cabinet("grid_import")
    assert float(shown["at the meter, measured"][0]) == account.comparison.measured_energy
    assert float(shown["at the meter, predicted"][0]) == account.comparison.predicted_energy
    assert float(shown["brake resistor"][0]) == account.registers.cabinet("brake")
    heads = "[...document.querySelectorAll('#registers tbody tr')].map(r => r.cells[0].textContent)"
    of_it = "from the grid, of it with learned figures"  # behind what it is a part of
    assert opened.run(f"return {heads}")[:2] == ["from the grid, predicted", of_it]
    joints = opened.values("shaft")
    friction = account.registers.joints("friction")
    for place, name in enumerate(recording[1].model.joint_names):
        assert float(joints[name][1]) == friction[place]


@pytest.mark.parametrize(
    ("at_meter", "learned", "shown"),
    [
        (float("nan"), 0.0, ""),
        (3_300.0, 0.0, "; -8.3 % against the meter"),
        (3_300.0, 1.0, "; -8.3 % against the meter, corrected by learned figures"),
    ],
)
def test_no_error_is_shown_while_the_prediction_at_the_meter_is_not_known(
    window, tmp_path, at_meter, learned, shown
):
    hub = PageHub("", PageSettings(), live=False)
    robot = hub.robot("r")
    robot.take_power(power_states([1.0], [100.0]), 0.0)
    values = {"measured_energy": 3600.0, "predicted_energy_at_meter": at_meter}
    robot.take_registers(registers(3600.0, **values, predicted_energy_learned=learned))
    hub.tick(0.0)
    path = tmp_path / "page.html"
    path.write_text(saved_page(hub.state(0.0)), encoding="utf-8")
    window.open(path.as_uri())
    window.wait("document.getElementById('energy').textContent !== ''", "the energy")
    assert window.text("energy-note").partition(";")[2] == shown.removeprefix(";")


def test_the_headline(opened, recording):
    joule = recording[1].account.registers.cabinet("grid_import")
    assert opened.text("energy") == f"{joule / 3600:.2f} Wh"
    assert opened.text("cost") == f"{joule / 3.6e6 * 0.3:.4f} EUR"
    assert opened.text("co2") == f"{joule / 3.6e6 * 400:.1f} g"
    status = "document.getElementById('status').textContent"
    opened.wait(f"/recording|saved page/.test({status})", "the kind of the page")


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (390, True)])
def test_no_serious_fault_of_accessibility(opened, width, dark):
    opened.dark(dark)
    opened.size(width, 900)
    opened.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert opened.faults() == []


def test_nothing_is_wider_than_a_phone(opened):
    opened.size(390, 844)
    opened.wait(
        "document.querySelector('#flow svg').getAttribute('viewBox').split(' ')[2] < 400", ""
    )
    assert opened.run("return document.documentElement.scrollWidth") == 390


def test_a_page_that_is_left_keeps_no_connection(window, recording, url, saved):
    streams = recording[0].hub.on_tick.__self__._app._stream._news
    for _ in range(3):
        window.open(url)
        wait_until(lambda: streams, "the stream of the page")
        window.open(saved)
        wait_until(lambda: not streams, "the end of the stream of the page that was left")


def test_the_lines_are_read_with_the_keyboard(opened):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.keys import Keys

    opened.run("document.querySelector('#lines svg').focus()")
    ActionChains(opened.driver).send_keys(Keys.ARROW_LEFT * 3).perform()
    label = opened.wait(
        "[...document.querySelectorAll('#lines text')].map(t => t.textContent)"
        ".find(t => t.includes('measured'))",
        "the values",
    )
    assert re.search(r"predicted \d+ W, measured \d+ W", label)


def test_the_keyboard_reaches_every_button(opened):
    from selenium.webdriver.common.keys import Keys

    seen = set()
    for _ in range(40):
        opened.driver.switch_to.active_element.send_keys(Keys.TAB)
        seen.add(
            opened.run(
                "const a = document.activeElement; return a.id || a.dataset.flow || a.dataset.span"
                " || a.tagName"
            )
        )
    assert {"theme", "energy_flow", "flow", "live", "hour", "shift", "all", "SUMMARY"} <= seen


def test_names_from_outside_are_text(window, tmp_path):
    evil = "<img src=x onerror=window.evil=1></script><script>window.evil=1</script>"
    hub = PageHub(evil, PageSettings(), live=False)
    robot = hub.robot(evil)
    robot.take_power(power_states([1.0, 1.2], [100.0, 200.0], names=(evil, "b")), 0.0)
    robot.take_registers(registers(7200.0, names=(evil, "b")))
    hub.tick(0.0)
    path = tmp_path / "page.html"
    path.write_text(saved_page(hub.state(0.0)), encoding="utf-8")
    window.complaints()
    window.open(path.as_uri())
    window.wait(READY, "the figures")
    assert window.run("return window.evil ?? null") is None
    assert evil in window.text("joints")
    assert window.complaints() == []
