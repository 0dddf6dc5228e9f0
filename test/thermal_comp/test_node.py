# SPDX-License-Identifier: Apache-2.0
"""The compensation node in-process: what goes in, what comes out, what diagnostics say."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    TemperatureSample,
    float_message,
    imu_from_sample,
    magnetic_field_from_sample,
    temperature_from_sample,
)
from sensor_msgs.msg import Imu, MagneticField
from thermal_comp.effects import EFFECTS
from thermal_comp.model.file import model_label, save_model
from thermal_comp.node import ThermalCompNode

from .models import line_model

SECOND = 1_000_000_000
UP = (0.0, 0.0, 9.80665)


def node(ros: Any, sent: list[tuple[str, Any]], **parameters: Any) -> ThermalCompNode:
    made = ThermalCompNode(
        capture=lambda topic, message: sent.append((topic, message)), parameters=parameters
    )
    assert made.autostart()
    return made


def feed(compensation: ThermalCompNode, stamp: int, temperature: float | None = None) -> None:
    if temperature is not None:
        compensation.inputs['imu/temperature'](
            temperature_from_sample(TemperatureSample(stamp, temperature))
        )
    compensation.inputs['imu/data_raw'](imu_from_sample(ImuSample(stamp, (0.0, 0.0, 0.0), UP)))
    compensation.inputs['imu/mag'](
        magnetic_field_from_sample(MagneticSample(stamp, (2e-5, 0.0, -4e-5)))
    )


def imu_messages(sent: list[tuple[str, Any]]) -> list[Imu]:
    return [message for topic, message in sent if topic == 'imu_compensated/data_raw']


@pytest.fixture
def model_path(tmp_path: Path) -> str:
    save_model(line_model(), tmp_path / 'model.yaml')
    return str(tmp_path / 'model.yaml')


def test_the_error_at_the_die_temperature_is_subtracted(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    feed(compensation, SECOND, 30.0)
    (imu,) = imu_messages(sent)
    # line_model: 1 mrad/s/K, 2 mm/s²/K and 30 nT/K on x; 30 °C is 10 K above the reference.
    assert imu.angular_velocity.x == pytest.approx(-0.01, abs=1e-12)
    assert imu.linear_acceleration.x == pytest.approx(-0.02, abs=1e-12)
    (field,) = [m for topic, m in sent if topic == 'imu_compensated/mag']
    assert field.magnetic_field.x == pytest.approx(2e-5 - 3e-7, abs=1e-15)
    assert compensation.diagnostics()[0] == 0


def test_covariance_is_noise_plus_model_uncertainty(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    feed(compensation, SECOND, 20.0)
    feed(compensation, 2 * SECOND, 30.0)
    at_reference, warm = (m.angular_velocity_covariance[0] for m in imu_messages(sent))
    noise = line_model().sensors['gyroscope'].noise.variance_of_means(1.0)[0]
    assert at_reference == pytest.approx(noise)
    assert warm - at_reference == pytest.approx((1e-5 * 10.0) ** 2)


def test_known_covariances_and_orientation_are_kept(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    compensation.inputs['imu/temperature'](
        temperature_from_sample(TemperatureSample(SECOND, 20.0))
    )
    message = imu_from_sample(
        ImuSample(
            SECOND,
            (0.0,) * 3,
            UP,
            angular_velocity_covariance=(4e-6, *[0.0] * 8),
            orientation=(0.0, 0.0, 0.6, 0.8),
            orientation_covariance=(1e-4, *[0.0] * 8),
        )
    )
    message.linear_acceleration_covariance[0] = -1.0
    compensation.inputs['imu/data_raw'](message)
    (imu,) = imu_messages(sent)
    assert imu.angular_velocity_covariance[0] == pytest.approx(4e-6)
    assert imu.linear_acceleration_covariance[0] == -1.0
    assert (imu.orientation.z, imu.orientation.w) == (0.6, 0.8)
    assert imu.orientation_covariance[0] == 1e-4


def test_without_a_fresh_temperature_data_pass_unchanged_and_uncertain(
    ros: Any, model_path: str
) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path, temperature_timeout=5.0)
    feed(compensation, SECOND, 30.0)
    feed(compensation, 6 * SECOND)
    feed(compensation, 7 * SECOND)
    fresh, edge, stale = imu_messages(sent)
    assert edge.angular_velocity.x == fresh.angular_velocity.x
    assert stale.angular_velocity.x == 0.0
    assert stale.angular_velocity_covariance[0] > 10.0 * edge.angular_velocity_covariance[0]
    level, line, values = compensation.diagnostics()
    assert level == 1
    assert 'no fresh temperature' in line
    assert values['passed_on'] == 1


def test_outside_the_fitted_range_the_error_of_the_edge_is_kept_on_request(
    ros: Any, model_path: str
) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path, extrapolate='clamp')
    for second, temperature in enumerate((45.0, 50.0, 70.0), 1):
        feed(compensation, second * SECOND, temperature)
    low, inside, outside = imu_messages(sent)
    assert outside.angular_velocity.x == pytest.approx(inside.angular_velocity.x)
    assert inside.angular_velocity.x == pytest.approx(30.0 / 25.0 * low.angular_velocity.x)
    assert outside.angular_velocity_covariance[0] > inside.angular_velocity_covariance[0]
    assert 'outside the fitted range: compensated as at the edge' in compensation.diagnostics()[1]


def test_outside_the_fitted_range_the_error_is_extrapolated_and_said(
    ros: Any, model_path: str
) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    feed(compensation, SECOND, 50.0)
    feed(compensation, 2 * SECOND, 70.0)
    inside, outside = imu_messages(sent)
    slope = inside.angular_velocity.x / 30.0
    assert outside.angular_velocity.x == pytest.approx(50.0 * slope)
    assert outside.angular_velocity_covariance[0] > inside.angular_velocity_covariance[0]
    assert 'outside the fitted range: extrapolated' in compensation.diagnostics()[1]


def test_the_newest_temperature_not_later_than_the_sample_counts(
    ros: Any, model_path: str
) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    for stamp, temperature in ((1, 25.0), (3, 35.0), (2, 30.0)):
        compensation.inputs['imu/temperature'](
            temperature_from_sample(TemperatureSample(stamp * SECOND, temperature))
        )
    feed(compensation, 2 * SECOND)
    feed(compensation, 3 * SECOND)
    assert [m.angular_velocity.x for m in imu_messages(sent)] == pytest.approx([-0.01, -0.015])


def test_without_a_model_data_pass_and_diagnostics_warn(ros: Any) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent)
    feed(compensation, SECOND, 30.0)
    assert imu_messages(sent)[0].linear_acceleration.z == UP[2]
    level, line, _ = compensation.diagnostics()
    assert level == 1
    assert 'no model' in line


def test_a_broken_model_refuses_the_configuration(ros: Any, tmp_path: Path) -> None:
    broken = tmp_path / 'model.yaml'
    broken.write_text('schema: 7\n')
    compensation = ThermalCompNode(
        capture=lambda topic, message: None, parameters={'model': str(broken)}
    )
    assert not compensation.autostart()
    missing = ThermalCompNode(
        capture=lambda topic, message: None, parameters={'model': str(tmp_path / 'none.yaml')}
    )
    assert not missing.autostart()


def test_a_clock_that_jumps_back_starts_anew(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    feed(compensation, 100 * SECOND, 40.0)
    feed(compensation, 5 * SECOND, 30.0)
    assert imu_messages(sent)[1].angular_velocity.x == pytest.approx(-0.01)
    assert np.isfinite(imu_messages(sent)[1].angular_velocity_covariance).all()


def model_with(effect: str, path: Path) -> str:
    line = line_model()
    sensors = {
        name: replace(part, effects=(EFFECTS[effect](),), contributions={effect: np.full(3, 1e-4)})
        for name, part in line.sensors.items()
    }
    save_model(replace(line, sensors=sensors), path)
    return str(path)


def test_the_history_outlives_a_restart(ros: Any, tmp_path: Path) -> None:
    model = model_with('thermal_lag', tmp_path / 'model.yaml')
    state = str(tmp_path / 'state.json')
    sent: list[tuple[str, Any]] = []
    whole = node(ros, sent, model=model)
    for second in range(4):
        feed(whole, second * SECOND, 20.0 + 5.0 * second)
    expected = imu_messages(sent)[-1].angular_velocity.x
    assert expected != 0.0

    sent.clear()
    first = node(ros, sent, model=model, state_file=state)
    assert 'history lost' in first.diagnostics()[1]
    for second in range(3):
        feed(first, second * SECOND, 20.0 + 5.0 * second)
    first.trigger_deactivate()
    second_life = node(ros, sent, model=model, state_file=state)
    feed(second_life, 3 * SECOND, 35.0)
    assert imu_messages(sent)[-1].angular_velocity.x == expected
    assert second_life.diagnostics()[2]['history'] == 'restored'


def test_a_channel_the_model_needs_is_subscribed_and_missed_until_it_comes(
    ros: Any, tmp_path: Path
) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_with('supply_sensitivity', tmp_path / 'm.yaml'))
    feed(compensation, SECOND, 30.0)
    assert 'not applied: supply_sensitivity' in compensation.diagnostics()[1]
    compensation.inputs['imu/supply_voltage'](float_message(3.4))
    feed(compensation, 2 * SECOND, 30.0)
    without, with_supply = imu_messages(sent)
    assert without.angular_velocity.x == 0.0
    assert with_supply.angular_velocity.x != 0.0
    assert with_supply.angular_velocity_covariance[0] < without.angular_velocity_covariance[0]
    assert compensation.diagnostics()[0] == 0
    assert 'chamber/heater' not in compensation.inputs


def test_compensated_data_are_not_compensated_again(ros: Any, model_path: str) -> None:
    first: list[tuple[str, Any]] = []
    feed(node(ros, first, model=model_path), SECOND, 30.0)
    (label,) = [m for topic, m in first if topic == 'imu_compensated/applied_model']
    assert label.data.startswith('model of dut1, sha256 ')

    sent: list[tuple[str, Any]] = []
    second = node(ros, sent, model=model_path)
    second.inputs['/imu/applied_model'](label)
    feed(second, SECOND, 30.0)
    assert imu_messages(sent)[0].angular_velocity.x == 0.0
    level, text, _ = second.diagnostics()
    assert level == 2
    assert f'compensated already ({label.data})' in text

    told: list[tuple[str, Any]] = []
    again = node(ros, told, model=model_path, again=True)
    again.inputs['/imu/applied_model'](label)
    feed(again, SECOND, 30.0)
    assert imu_messages(told)[0].angular_velocity.x == pytest.approx(-0.01, abs=1e-12)


def test_a_model_of_another_device_is_refused(ros: Any, model_path: str) -> None:
    compensation = ThermalCompNode(
        capture=lambda *_: None, parameters={'model': model_path, 'device': 'dut2'}
    )
    assert not compensation.autostart()
    assert 'the model is of dut1, the data of dut2' in compensation.refused


def stream(
    compensation: ThermalCompNode, count: int, *, force: float = 9.80665, temperature: float = 30.0
) -> None:
    """Feed samples at 100 Hz: gravity as large as told, the die as warm as told."""
    for k in range(count):
        stamp = compensation.check.newest + SECOND // 100 if k else 10 * SECOND
        compensation.inputs['imu/temperature'](
            temperature_from_sample(TemperatureSample(stamp, temperature))
        )
        sample = ImuSample(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, force))
        compensation.inputs['imu/data_raw'](imu_from_sample(sample))


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'force': 1.0}, 'linear_acceleration: the median norm is 1 m/s², expected 7 … 13'),
        ({'temperature': 303.15}, 'temperature (imu/temperature) reaches 303.1'),
    ],
)
def test_a_live_stream_in_another_unit_is_passed_on_and_named(
    ros: Any, model_path: str, wrong: dict[str, float], words: str
) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    stream(compensation, 40, **wrong)
    assert [message.angular_velocity.x for message in imu_messages(sent)[20:]] == [0.0] * 20
    level, said, _ = compensation.diagnostics()
    assert level == 2
    assert words in said
    assert 'pass through unchanged; parameter accept_units' in said
    told = node(ros, sent, model=model_path, accept_units=True)
    stream(told, 40, force=1.0)
    assert imu_messages(sent)[-1].angular_velocity.x == pytest.approx(-0.01, abs=1e-12)


def test_a_stream_that_becomes_right_is_compensated_again(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    stream(compensation, 40, force=1.0)
    stream(compensation, 2100)
    assert imu_messages(sent)[-1].angular_velocity.x == pytest.approx(-0.01, abs=1e-12)
    assert compensation.diagnostics()[0] == 0


def test_a_single_impossible_sample_spoils_no_other(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    stream(compensation, 200)
    variance = compensation.compensator.vibration
    spoilt = ImuSample(compensation.check.newest + 1, (0.0, 0.0, 0.0), (3.4e38, 0.0, 9.8))
    compensation.inputs['imu/data_raw'](imu_from_sample(spoilt))
    assert imu_messages(sent)[-1].linear_acceleration.x == 3.4e38
    assert compensation.compensator.vibration is variance
    level, said, values = compensation.diagnostics()
    assert (level, values['damaged']) == (1, 1)
    assert 'impossible samples' in said


def test_stamps_that_stand_still_are_named(ros: Any, model_path: str) -> None:
    compensation = node(ros, [], model=model_path)
    for _ in range(30):
        feed(compensation, 0, 30.0)
    assert 'stand still at 0 ns' in compensation.diagnostics()[1]


def test_what_is_passed_on_is_not_labelled_as_compensated(ros: Any, model_path: str) -> None:
    sent: list[tuple[str, Any]] = []
    compensation = node(ros, sent, model=model_path)
    own = compensation.compensator.model.device
    for second, device in enumerate((own, 'dut9', own), start=1):
        compensation.check_source(device)
        for part in range(3):
            feed(compensation, second * SECOND + part, 30.0)
    told = [m.data for topic, m in sent if topic == 'imu_compensated/applied_model']
    label = model_label(compensation.compensator.model)
    assert told == [label, '', label]
    rates = [message.angular_velocity.x for message in imu_messages(sent)]
    assert [rate == 0.0 for rate in rates] == [False] * 3 + [True] * 3 + [False] * 3


def test_a_magnetometer_of_another_device_is_told_where_no_imu_comes(
    ros: Any, model_path: str
) -> None:
    driver = ros.create_node('some_driver', namespace='/half')
    publisher = driver.create_publisher(MagneticField, 'imu/mag', 10)
    compensation = ThermalCompNode(namespace='/half', parameters={'model': model_path})
    assert compensation.autostart()
    status = DiagnosticStatus(name='half/some_driver', hardware_id='DUT9')
    compensation.inputs['/diagnostics'](DiagnosticArray(status=[status]))
    level, line, _ = compensation.diagnostics()
    assert level == 2
    assert 'the data of DUT9' in line
    compensation.destroy_node()
    driver.destroy_publisher(publisher)


def test_data_of_another_device_pass_unchanged_and_are_an_error(ros: Any, model_path: str) -> None:
    driver = ros.create_node('some_driver', namespace='/here')
    publisher = driver.create_publisher(Imu, 'imu/data_raw', 10)
    compensation = ThermalCompNode(namespace='/here', parameters={'model': model_path})
    assert compensation.autostart()
    sent: list[ImuSample] = []
    compensation._imu.send = sent.append
    own = compensation.compensator.model.device
    sample = ImuSample(SECOND, (0.0,) * 3, UP)
    for name, device in (
        ('here/some_driver', 'DUT9'), ('there/some_driver', own), ('here/some_driver', own),
    ):  # fmt: skip
        status = DiagnosticStatus(name=name, hardware_id=device)
        compensation.inputs['/diagnostics'](DiagnosticArray(status=[status]))
        compensation.on_temperature(TemperatureSample(SECOND, 30.0))
        compensation.on_imu(sample)
    level, line, _ = compensation.diagnostics()
    assert sent[:2] == [sample] * 2
    assert sent[2] != sample
    assert level == 0, line
    compensation.check_source(compensation.compensator.model.device.upper())
    assert compensation.diagnostics()[0] < 2
    compensation.check_source('DUT9')
    level, line, _ = compensation.diagnostics()
    assert level == 2
    assert f'the model is of {own}, the data of DUT9' in line
    assert 'allow_other_device' in line
    compensation.destroy_node()
    allowed = ThermalCompNode(parameters={'model': model_path, 'allow_other_device': True})
    assert allowed.autostart()
    assert '/diagnostics' not in allowed.inputs
    allowed.destroy_node()
    driver.destroy_publisher(publisher)
    driver.destroy_node()


@pytest.mark.parametrize(
    ('value', 'words'),
    [
        (lambda k: float('nan'), 'the thermometer has no value (NaN)'),
        (lambda k: 21.4375, 'the thermometer stands at 21.4375 °C for 12 min'),
        (lambda k: 20.0 + k // 20, 'temperature in whole degrees'),
        (lambda k: 20.0 + 0.0625 * (k % 3), ''),
    ],
)
def test_a_thermometer_out_of_order_is_named(
    ros: Any, model_path: str, value: Any, words: str
) -> None:
    compensation = node(ros, [], model=model_path)
    for k in range(73):
        stamp = (1 + 10 * k) * SECOND
        compensation.on_temperature(TemperatureSample(stamp, value(k)))
        compensation.on_imu(ImuSample(stamp, (0.0, 0.0, 0.0), UP))
    level, said, _ = compensation.diagnostics()
    assert words in said
    assert level == int(bool(words)), said
