# SPDX-License-Identifier: Apache-2.0
"""Build and install thermal_comp."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'thermal_comp'

setup(
    name=NAME,
    version='0.2.0',
    packages=find_packages(),
    package_data={
        NAME: [
            'py.typed',
            '*.yaml',
            *(f'export/*.{suffix}' for suffix in ('in', 'cmake', 'package.xml')),
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest'], 'plot': ['matplotlib']},
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='Finds, fits and removes the temperature error of MEMS IMUs, per axis and per device.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'thermal_comp_node = thermal_comp.node:main',
        ],
    },
)
