# SPDX-License-Identifier: Apache-2.0
"""Model files: exact both ways, and every refusal names the field."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from imu_recording.plausibility import POSSIBLE_RANGES
from thermal_comp.data.quality import IMPOSSIBLE_TEXTS
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_step import BiasStep
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.temperature_rate import TemperatureRate
from thermal_comp.model.bounds import typical_conditions
from thermal_comp.model.file import check_device, load_model, save_model
from thermal_comp.model.values import ModelError, SensorModel, ThermalModel

from ..models import line_model


def rich_model() -> ThermalModel:
    """Every kind of coefficient: per axis, shared, per run, with shape parameters and history."""
    rng = np.random.default_rng(5)
    effects = (
        EFFECTS['bias_temperature'](),
        EFFECTS['thermal_lag'](time_constant=123.456789),
        EFFECTS['thermal_hysteresis'](half_widths=(3.3, 7.7)),
        EFFECTS['fixture_tilt'](),
        EFFECTS['bias_step'](step_time=(1e4 / 3.0,)),
    )
    shapes = ((1, 3), (1, 3), (2, 3), (3,), (2, 1, 3))
    coefficients = tuple(rng.standard_normal(shape) * 1e-5 for shape in shapes)
    size = sum(c.size for c in coefficients)
    root = rng.standard_normal((size, size)) * 1e-7
    sensor = replace(
        line_model().sensors['accelerometer'],
        effects=effects,
        coefficients=coefficients,
        covariance=root @ root.T,
        shape_std={'thermal_lag.time_constant': (2.5,), 'thermal_hysteresis.half_widths': (1, 2)},
        contributions={effect.name: rng.random(3) for effect in effects},
    )
    earlier = line_model()
    return earlier.succeeded_by(replace(earlier, sensors={'accelerometer': sensor}))


def test_a_model_read_back_is_the_model_written(tmp_path: Path) -> None:
    model = rich_model()
    save_model(model, tmp_path / 'model.yaml')
    back = load_model(tmp_path / 'model.yaml')
    assert back.to_dict() == model.to_dict()
    assert back.sensors['accelerometer'].effects == model.sensors['accelerometer'].effects
    np.testing.assert_array_equal(
        back.sensors['accelerometer'].covariance, model.sensors['accelerometer'].covariance
    )
    assert len(back.history) == 1
    assert list(back.history[0].sensors) == list(line_model().sensors)


def test_an_empty_model_is_kept_too(tmp_path: Path) -> None:
    noise = line_model().sensors['gyroscope'].noise
    empty = SensorModel((), (), np.zeros((0, 0)), noise, temperature_range=(0.0, 1.0))
    save_model(replace(line_model(), sensors={'gyroscope': empty}), tmp_path / 'model.yaml')
    assert load_model(tmp_path / 'model.yaml').sensors['gyroscope'].effects == ()


@pytest.mark.parametrize(
    ('effect', 'size', 'left_out'),
    [
        (BiasStep((300.0,)), (1, 1, 3), 'duration'),
        (TemperatureRate(), (1, 3), 'smoothing'),  # files of version 0.1 have none
    ],
)
def test_what_is_assumed_may_be_absent_in_the_file(
    tmp_path: Path, effect: Effect, size: tuple[int, ...], left_out: str
) -> None:
    sensor = replace(
        line_model().sensors['gyroscope'],
        effects=(effect,),
        coefficients=(np.ones(size),),
        covariance=np.eye(3),
        contributions={},
    )
    document = replace(line_model(), sensors={'gyroscope': sensor}).to_dict()
    del document['sensors']['gyroscope']['effects'][0]['shape'][left_out]
    (tmp_path / 'model.yaml').write_text(yaml.safe_dump(document))
    assert load_model(tmp_path / 'model.yaml').sensors['gyroscope'].effects == (effect,)


def changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    document = rich_model().to_dict()
    place: Any = document
    for key in path[:-1]:
        place = place[key]
    if value is KeyError:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return document


SENSOR = ('sensors', 'accelerometer')


@pytest.mark.parametrize(
    ('path', 'value', 'message'),
    [
        (('schema',), 2, 'schema: is 2, this version reads 1'),
        (('schema',), KeyError, 'schema: missing'),
        (('pooled',), KeyError, 'pooled: missing'),
        (('scheme',), 1, 'scheme: no such field'),
        ((*SENSOR, 'noise'), KeyError, 'noise: missing'),
        ((*SENSOR, 'noise', 'white', 'value'), [1.0, -1.0, 1.0], 'white: has a negative'),
        (('device',), KeyError, 'device: missing'),
        (('device',), 7, 'device: is 7, expected text'),
        (('reference_temperature', 'unit'), 'K', "reference_temperature.unit: is 'K'"),
        (('reference_temperature', 'value'), float('nan'), 'reference_temperature.value: is nan'),
        (('sensors',), {}, 'sensors: holds no sensor'),
        (('sensors',), {'barometer': {}}, 'sensors.barometer: no such sensor'),
        ((*SENSOR, 'unit'), 'g', "accelerometer.unit: is 'g', expected 'm/s²'"),
        ((*SENSOR, 'covariance'), [[1.0]], 'accelerometer.covariance: has shape'),
        ((*SENSOR, 'temperature_range', 'value'), [50, -10], 'the lower end comes first'),
        ((*SENSOR, 'noise', 'white'), KeyError, 'noise.white: missing'),
        ((*SENSOR, 'noise', 'time_constants', 'value'), [-1.0], 'not positive'),
        ((*SENSOR, 'effects', 0, 'name'), 'magic', r"effects\[0\].name: 'magic' .* --effects"),
        ((*SENSOR, 'effects', 0, 'coefficients'), [[1, 2]], r'effects\[0\].coefficients: has sha'),
        ((*SENSOR, 'effects', 0, 'coefficients'), [[1, 2, float('inf')]], 'expected a finite'),
        ((*SENSOR, 'effects', 0, 'coefficients'), [[1, 2, 'x']], "'x' is no number"),
        ((*SENSOR, 'effects', 1, 'shape', 'time_constant', 'value'), 0.1, 'expected 0.2 … 3600'),
        ((*SENSOR, 'effects', 1, 'shape', 'time_constant'), KeyError, 'time_constant: missing'),
        ((*SENSOR, 'effects', 1, 'shape', 'width'), {'value': 1}, 'has no such parameter'),
        ((*SENSOR, 'effects', 2, 'coefficients'), [[1, 2, 3]], r'effects\[2\].coefficients'),
        (('provenance',), KeyError, 'provenance: missing'),
        (('history',), [{'schema': 9}], 'schema: is 9'),
        (('effects',), [], 'effects: no such field; there are schema, device'),
        ((*SENSOR, 'noise', 'effects'), [], 'accelerometer.noise.effects: no such field'),
        ((*SENSOR, 'coefficients'), [], 'accelerometer.coefficients: no such field; there are un'),
        ((*SENSOR, 'effects', 0, 'effects'), [], r'effects\[0\].effects: no such field'),
        ((*SENSOR, 'effects', 1, 'name'), 'bias_temperature', 'has no such parameter|there twice'),
        (('provenance', 'effects'), [], 'provenance.effects: no such field'),
        (('reference_temperature', 'effects'), [], 'reference_temperature.effects: no such'),
    ],
)
def test_every_refusal_names_file_and_field(
    tmp_path: Path, path: tuple[Any, ...], value: Any, message: str
) -> None:
    file = tmp_path / 'model.yaml'
    file.write_text(yaml.safe_dump(changed(path, value), allow_unicode=True))
    with pytest.raises(ModelError, match=message) as refusal:
        load_model(file)
    assert str(file) in str(refusal.value)
    assert '\n' not in str(refusal.value)


def test_an_asymmetric_or_negative_covariance_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'model.yaml'
    for row, column, value, message in ((0, 1, 1.0, 'symmetric'), (0, 0, -1.0, 'negative')):
        document = rich_model().to_dict()
        document['sensors']['accelerometer']['covariance'][row][column] = value
        file.write_text(yaml.safe_dump(document))
        with pytest.raises(ModelError, match=message):
            load_model(file)


def test_a_file_that_is_no_model_is_one_clear_line(tmp_path: Path) -> None:
    file = tmp_path / 'model.yaml'
    for text in ('', '[1, 2', '- 1\n- 2\n', '!!python/object:os.system {}', '\x00'):
        file.write_text(text)
        with pytest.raises(ModelError) as refusal:
            load_model(file)
        assert '\n' not in str(refusal.value)


def test_numbers_written_by_hand_without_a_point_are_numbers(tmp_path: Path) -> None:
    file = tmp_path / 'model.yaml'
    save_model(line_model(), file)
    text = file.read_text().replace('- [0.001, -0.0005, 0.0]', '- [1e-3, -5e-4, 0]')
    assert '1e-3' in text
    file.write_text(text)
    np.testing.assert_array_equal(
        load_model(file).sensors['gyroscope'].coefficients[0], [[1e-3, -5e-4, 0.0]]
    )


def test_the_wrong_device_is_refused_and_a_pooled_model_serves_its_devices() -> None:
    with pytest.raises(ModelError, match='device: the model is of dut1, the data of dut2'):
        check_device(line_model(), 'dut2')
    check_device(line_model(), '')
    check_device(replace(line_model(), device='dut1+dut2', pooled=True), 'dut2')


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('device: dut1', 'device: is there twice, again in line'),
        ('sensors: {}', 'sensors: is there twice'),
    ],
)
def test_a_key_that_stands_twice_is_refused(tmp_path: Path, line: str, message: str) -> None:
    file = tmp_path / 'model.yaml'
    save_model(rich_model(), file)
    file.write_text(f'{file.read_text()}{line}\n')
    with pytest.raises(ModelError, match=message):
        load_model(file)


def test_a_nested_key_that_stands_twice_is_refused_by_its_whole_name(tmp_path: Path) -> None:
    file = tmp_path / 'model.yaml'
    save_model(line_model(), file)
    text = file.read_text()
    assert text.count('    effects:\n') == 3
    doubled = text.replace('    covariance:', '    effects: []\n    covariance:', 1)
    file.write_text(doubled)
    with pytest.raises(ModelError, match=r'sensors\.accelerometer\.effects: is there twice'):
        load_model(file)


def test_an_effect_that_stands_twice_in_a_sensor_is_refused(tmp_path: Path) -> None:
    document = line_model().to_dict()
    document['sensors']['gyroscope']['effects'] *= 2
    file = tmp_path / 'model.yaml'
    file.write_text(yaml.safe_dump(document, allow_unicode=True))
    with pytest.raises(ModelError, match=r"gyroscope.effects\[1\].name: 'bias_temperature' is th"):
        load_model(file)


@pytest.mark.parametrize(
    ('place', 'value', 'named'),
    [
        (('reference_temperature', 'value'), 1e6, r'reference_temperature\.value: is 1e\+06 °C'),
        (
            ('sensors', 'gyroscope', 'temperature_range', 'value'),
            [-300.0, 50.0],
            r'temperature_range\.value: is -300 °C',
        ),
        (
            ('sensors', 'accelerometer', 'effects', 0, 'coefficients'),
            [[1e300, 0.0, 0.0]],
            r'accelerometer\.effects\[0\]\.coefficients: bias_temperature would make an error of',
        ),
        (
            ('sensors', 'accelerometer', 'effects', 0, 'coefficients'),
            [[0.0, 430.0, 0.0]],
            r'possible is up to 10 m/s²',
        ),
        (
            ('sensors', 'magnetometer', 'effects', 0, 'rms'),
            [0.0, 0.0, 12.0],
            r'magnetometer\.effects\[0\]\.rms: is 12 T',
        ),
        (
            ('sensors', 'gyroscope', 'noise', 'white', 'value'),
            [1e9, 0.0, 0.0],
            r'gyroscope\.noise\.white\.value: is 1e\+09 rad/s',
        ),
        (
            ('sensors', 'gyroscope', 'covariance'),
            np.diag([1e300, 1.0, 1.0]).tolist(),
            r'gyroscope\.covariance: the error of bias_temperature would be uncertain',
        ),
    ],
)
def test_numbers_that_no_sensor_has_are_refused_by_their_field(
    tmp_path: Path, place: tuple[str | int, ...], value: Any, named: str
) -> None:
    document = line_model().to_dict()
    entry: Any = document
    for key in place[:-1]:
        entry = entry[key]
    entry[place[-1]] = value
    file = tmp_path / 'model.yaml'
    file.write_text(yaml.safe_dump(document, allow_unicode=True))
    with pytest.raises(ModelError, match=named):
        load_model(file)


@pytest.mark.parametrize('track', IMPOSSIBLE_TEXTS)
def test_errors_are_bounded_in_conditions_that_can_be(track: str) -> None:
    conditions = typical_conditions(-10.0, 50.0, 20.0, 'accelerometer')
    low, high = POSSIBLE_RANGES[track]
    values = getattr(conditions, track)
    assert low <= values.min() <= values.max() <= high
    assert track != 'pressure' or values.min() > 3e4  # on Earth


@pytest.mark.parametrize('text', ['a: ' + '[' * 100_000, 'device: 2024-99-99'])
def test_yaml_that_python_cannot_hold_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / 'm.yaml'
    file.write_text(text)
    with pytest.raises(ModelError, match=r'm\.yaml: not a YAML file: '):
        load_model(file)
