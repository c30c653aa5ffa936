"""The energy flow balances in whole displayed units, whatever the signs."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy_report.page.energy_flow import FlowParts, flow_picture, rounded_parts, unit_for

watts = st.floats(-20_000.0, 20_000.0)
losses = st.floats(0.0, 20_000.0)


def parts(rigid, friction, loss, **cabinet):
    names = [f"a{number}" for number in range(len(rigid))]
    values = dict.fromkeys(("loss_dc", "loss_grid", "brake", "capacitor", "returned"), 0.0)
    return FlowParts(names, rigid, friction, loss, **(values | cabinet))


def sums(picture):
    into, out = dict.fromkeys(picture.labels, 0), dict.fromkeys(picture.labels, 0)
    for flow in picture.flows:
        out[flow.source] += flow.units
        into[flow.target] += flow.units
    return into, out


@given(
    st.lists(st.tuples(watts, losses, losses), min_size=1, max_size=7),
    losses, losses, losses, watts, losses, st.lists(losses, max_size=3),
)  # fmt: skip
def test_every_inner_node_gives_what_it_takes(
    axes, loss_dc, loss_grid, brake, capacitor, returned, loads
):
    rigid, friction, loss = zip(*axes, strict=True)
    given_parts = parts(
        rigid, friction, loss, loss_dc=loss_dc, loss_grid=loss_grid, brake=brake,
        capacitor=capacitor, returned=returned,
        auxiliary=[(f"load {number}", size) for number, size in enumerate(loads)],
    )  # fmt: skip
    picture = flow_picture(given_parts)
    into, out = sums(picture)
    assert all(flow.units > 0 for flow in picture.flows)
    for node in picture.labels:
        if into[node] and out[node]:
            assert into[node] == out[node], node
    assert out.get("grid", 0) - into.get("grid_back", 0) == picture.net
    assert abs(picture.net * picture.unit - math.fsum(given_parts.terms)) <= picture.unit
    assert set(picture.labels) == {
        node for flow in picture.flows for node in (flow.source, flow.target)
    }


def test_what_is_not_modelled_has_no_flow():
    known = flow_picture(parts([5.0], [100.0], [math.nan], loss_grid=250.0, capacitor=math.nan))
    assert not {"drives", "capacitor", "capacitor_in"} & {*known.labels}
    assert known.net * known.unit == pytest.approx(355.0)
    assert flow_picture(parts([5.0], [math.nan], [1.0])) is None  # friction is unknown


def test_the_outlet_feeds_cabinet_and_loads():
    loads = [("pump", 800.0), ("panel", 35.0), ("idle", 0.0)]
    picture = flow_picture(parts([0.0], [100.0], [20.0], loss_grid=250.0, auxiliary=loads))
    flows = {(flow.source, flow.target): flow.units * picture.unit for flow in picture.flows}
    assert flows["grid", "load0"] == pytest.approx(800.0)
    assert flows["grid", "load1"] == pytest.approx(35.0)
    assert picture.net * picture.unit == pytest.approx(1205.0)
    assert picture.labels["grid"] == "Outlet"
    assert (picture.labels["load0"], "load2" in picture.labels) == ("pump", False)


def test_a_braking_axis_is_a_source():
    picture = flow_picture(
        parts([500.0, -400.0], [100.0, 50.0], [20.0, 30.0], loss_dc=60.0, loss_grid=250.0)
    )
    assert (picture.net, picture.unit) == (6100, 0.1)
    flows = {(flow.source, flow.target): flow.units // 10 for flow in picture.flows}
    assert flows == {
        ("grid", "bus"): 360,
        ("grid", "cabinet"): 250,
        ("axis1", "bus"): 320,
        ("bus", "axis0"): 620,
        ("bus", "cabinet"): 60,
        ("axis0", "friction"): 100,
        ("axis0", "drives"): 20,
        ("axis0", "motion"): 500,
        ("axis1", "friction"): 50,
        ("axis1", "drives"): 30,
    }
    assert picture.labels["axis1"] == "a1 brakes"


def test_a_supply_that_feeds_back_covers_its_own_loss_from_the_bus():
    picture = flow_picture(parts([-700.0], [50.0], [0.0], loss_grid=100.0, returned=550.0))
    flows = {(flow.source, flow.target): flow.units for flow in picture.flows}
    assert picture.net == -5500
    assert flows[("bus", "grid_back")] == 5500
    assert flows[("bus", "cabinet")] == 1000
    assert ("grid", "bus") not in flows


def test_an_unknown_term_gives_no_picture():
    assert flow_picture(parts([math.nan], [1.0], [1.0])) is None


@given(st.lists(watts, min_size=1, max_size=30))
def test_rounded_parts_sum_to_the_rounded_sum(values):
    whole = rounded_parts(values, 0.01)
    assert sum(whole) == round(math.fsum(value / 0.01 for value in values))
    assert all(
        abs(unit - value / 0.01) < 1.0 + 1e-6 for unit, value in zip(whole, values, strict=True)
    )


@pytest.mark.parametrize(
    ("largest", "unit"),
    [(0.0, 1.0), (12345.0, 1.0), (1234.0, 1.0), (610.0, 0.1), (14.72, 0.01), (0.5, 0.001)],
)
def test_units_leave_few_digits(largest, unit):
    assert unit_for(largest) == pytest.approx(unit)
