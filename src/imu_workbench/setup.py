# SPDX-License-Identifier: Apache-2.0
"""Build and install imu_workbench."""

import runpy
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'imu_workbench'
HERE = Path(__file__).resolve().parent
# One executable per verb, so that `ros2 run imu_workbench VERB` works.
VERBS = runpy.run_path(str(HERE / NAME / 'commands' / '__init__.py'))['COMMANDS']

setup(
    name=NAME,
    version='0.2.0',
    packages=find_packages(),
    package_data={
        NAME: [
            'py.typed',
            'report/html/templates/*',
            'report/schemas/*',
            'data/*.csv',
            'web/*.css',
            'web/*.js',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools', 'jinja2', 'markupsafe'],
    extras_require={
        'test': ['pytest'],
        'web': ['nicegui', 'tsdownsample'],
        'pdf': ['weasyprint', 'matplotlib', 'lxml', 'signxml'],
        'fleet': ['dask', 'distributed', 'pyarrow', 'duckdb', 'fsspec', 'scikit-learn'],
    },
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='Commands, report and web page that compare IMU thermal models with measurements.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [f'{verb} = {NAME}.__main__:run_verb' for verb in VERBS],
    },
)
