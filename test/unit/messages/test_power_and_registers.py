"""What the dashboards read is what the books say, field by field."""

import numpy as np
import pytest

import accounts
import robots
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS
from robot_energy.accounting.totals import Totals
from robot_energy.bag.cdr.types import typestore
from robot_energy.messages.fields import EXACT_FIELDS, EXACT_JOINT_FIELDS, SHAFT_FIELDS
from robot_energy.messages.power import PowerStateWriter
from robot_energy.messages.registers import RegistersWriter, outlet_fields
from robot_energy.model.payload import payload
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import (
    EffortMeaning,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    Phase,
)


@pytest.fixture(scope="module")
def run():
    """The two-link arm swinging under a meter that reads 200 W, with its last means."""
    pipeline = EnergyPipeline(robots.two_link(), Settings(effort=EffortMeaning.MOTOR_TORQUE))
    pipeline.torque.set_payload(payload("fore", 1.5))
    stamp = 10.0 + np.arange(400) / 200
    phase = np.stack([8 * stamp, 13 * stamp], axis=1)
    effort = np.tile([0.7, np.nan], (400, 1))  # nothing is measured of the elbow
    joints = robots.joint_block(stamp, np.sin(phase), np.cos(phase) * [8, 13], effort=effort)
    reading = joints.stamp_ns[::20]
    nothing = np.full(len(reading), np.nan)
    meter = MeterBlock(reading, np.full(len(reading), 200.0), nothing, nothing,
                       MeterMeaning.INSTANTANEOUS, MeterLocation.GRID)  # fmt: skip
    means = pipeline.step(joints, meter=meter).means
    pipeline.flush()
    return pipeline, means


def decode(rows, msgtype):
    return typestore().deserialize_cdr(rows[-1].tobytes(), f"ros2_energy_msgs/msg/{msgtype}")


def test_power_state(run):
    pipeline, means = run
    model = pipeline.model
    rows = PowerStateWriter(model.joint_names, model.model_id).encode(means, MeterLocation.GRID)
    state = decode(rows, "PowerState")
    assert state.model_id == model.model_id
    assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == means.stamp_ns[-1]
    assert state.phase in (Phase.MOTION, Phase.GENERATING)
    assert state.meter_location == MeterLocation.GRID
    assert state.measured_power == pytest.approx(200.0)
    assert state.residual_power == pytest.approx(state.predicted_power_at_meter - 200.0)
    parts = state.rigid_power + state.friction_power + state.drive_loss
    assert state.bus_power == pytest.approx(parts)
    total = parts + state.loss_dc + state.loss_grid + state.brake_power + state.capacitor_power
    assert state.predicted_grid_power == pytest.approx(total)
    assert state.loss_dc == pytest.approx(20.0)
    assert state.loss_grid == pytest.approx(30.0)
    assert [joint.name for joint in state.joints] == ["shoulder", "elbow"]
    assert sum(joint.friction_power for joint in state.joints) == pytest.approx(
        state.friction_power
    )
    for joint, expected in zip(state.joints, means.powers["rigid"][-1], strict=True):
        assert joint.rigid_power == expected
        assert joint.shaft_power == pytest.approx(joint.rigid_power + joint.friction_power)
        assert joint.drive_power == pytest.approx(joint.shaft_power + joint.drive_loss)
        assert np.isnan(joint.motor_temperature_degc)
    assert state.joints[0].coulomb == 0.1
    assert state.joints[0].motor_torque_measured == 0.7
    assert state.joints[0].shaft_power_measured == means.shaft_power_measured[-1, 0]
    assert abs(state.joints[0].shaft_power_measured) > 1.0
    assert np.isnan(state.joints[1].motor_torque_measured)
    assert np.isnan(state.joints[1].shaft_power_measured)
    assert state.payload_mass == 1.5


def test_energy_registers(run):
    pipeline, _ = run
    model, account = pipeline.model, pipeline.account
    found = decode(
        RegistersWriter(model.joint_names, model.model_id).encode(account), "EnergyRegisters"
    )
    fields = {"grid_import": "predicted_import_energy", "grid_return": "predicted_return_energy"}
    values = {name: getattr(found, fields.get(name, f"{name}_energy"))
              for name in CABINET_REGISTERS}  # fmt: skip
    assert values == {name: account.registers.cabinet(name) for name in CABINET_REGISTERS}
    assert len({*values.values()}) >= 4  # no field shows another's register
    assert found.energy_start.sec == 10
    assert found.measured_energy == pytest.approx(200.0 * found.comparison_time)
    assert np.isnan(found.predicted_energy_at_meter)  # 2 s of motion with a lag that is not known
    account.comparison.swing[2] = 0
    found = decode(
        RegistersWriter(model.joint_names, model.model_id).encode(account), "EnergyRegisters"
    )
    assert found.predicted_energy_at_meter == account.comparison.predicted_energy
    assert found.observed_time == pytest.approx(399 / 200)
    names = {"shaft_positive": "shaft_energy_positive", "shaft_negative": "shaft_energy_negative"}
    for index, joint in enumerate(found.joints):
        for name in JOINT_REGISTERS:
            field = names.get(name, f"{name}_energy")
            assert getattr(joint, field) == account.registers.joints(name)[index]
    shoulder, elbow = found.joints
    sums = {field: getattr(shoulder, field) for field in SHAFT_FIELDS.values()}
    assert sums == {field: account.shaft.joints(name)[0] for name, field in SHAFT_FIELDS.items()}
    assert len({*sums.values()}) == 4  # no field shows another's register
    assert shoulder.shaft_compared_time == pytest.approx(399 / 200)
    assert shoulder.shaft_energy_positive_compared == shoulder.shaft_energy_positive
    assert all(np.isnan(getattr(elbow, field)) for field in SHAFT_FIELDS.values())
    assert elbow.shaft_compared_time == 0.0


def test_whole_seconds_have_no_tail():
    for whole in range(1, 2000):
        totals = Totals.model_construct(outlet_ns=whole * 10**9)
        assert outlet_fields(totals)["outlet_time"] == whole


def test_exact_registers(run):
    pipeline, _ = run
    model, account = pipeline.model, pipeline.account
    writer = RegistersWriter(model.joint_names, model.model_id)
    found = decode(writer.encode(account, minute_ns=120 * 10**9), "EnergyRegisters")
    assert (found.minute.sec, found.minute.nanosec) == (120, 0)
    record = account.state(accounts.IDENTITY)
    cabinet = record.totals.cabinet_energy_microjoule
    assert {name: getattr(found, field) for name, field in EXACT_FIELDS.items()} == {
        name: cabinet[name] for name in CABINET_REGISTERS
    }
    assert found.predicted_import_energy == found.predicted_import_microjoule / 1e6
    assert found.measured_microjoule == record.totals.measured_energy_microjoule > 0
    assert found.predicted_microjoule_at_meter == record.totals.predicted_energy_at_meter_microjoule
    times = record.totals.observed_ns, record.totals.gap_ns, record.totals.compared_ns
    assert (found.observed_ns, found.gap_ns, found.compared_ns) == times
    assert found.phase_microjoule.tolist() == [*record.phase_energy_microjoule.values()]
    assert found.phase_ns.tolist() == [*record.phase_observed_ns.values()]
    assert found.phase_ns.sum() == found.observed_ns
    assert found.meter_location == MeterLocation.GRID
    for index, joint in enumerate(found.joints):
        for name, field in EXACT_JOINT_FIELDS.items():
            counted = record.totals.joint_energy_microjoule[name][index]
            assert getattr(joint, field) == counted


def test_a_part_that_is_not_modelled_is_not_a_number(run):
    pipeline, means = run
    model, account = pipeline.model, pipeline.account
    identity = (model.joint_names, model.model_id, (), {"drive_loss", "capacitor"})
    state = decode(PowerStateWriter(*identity).encode(means, MeterLocation.GRID), "PowerState")
    assert np.isnan([state.drive_loss, *(joint.drive_loss for joint in state.joints)]).all()
    assert state.bus_power == pytest.approx(state.rigid_power + state.friction_power)
    found = decode(RegistersWriter(*identity).encode(account), "EnergyRegisters")
    for register, shown in (
        ("drive_loss", [joint.drive_loss_energy for joint in found.joints]),
        ("capacitor", [found.capacitor_energy]),
    ):
        counted = (
            account.registers.joints(register)
            if register == "drive_loss"
            else np.array([account.registers.cabinet(register)])
        )
        assert np.array_equal(np.isnan(shown), counted == 0.0)  # what was counted stays


def test_no_registers_before_the_first_sample():
    model = robots.two_link()
    writer = RegistersWriter(model.joint_names, model.model_id)
    assert writer.encode(EnergyPipeline(model).account) is None
