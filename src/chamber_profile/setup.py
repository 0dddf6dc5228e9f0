# SPDX-License-Identifier: Apache-2.0
"""Build and install chamber_profile."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'chamber_profile'

setup(
    name=NAME,
    version='0.2.0',
    packages=find_packages(),
    package_data={NAME: ['py.typed', 'profile/*.json', 'profile/shipped/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools', 'pymodbus>=3.11,<4'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='Runs a climatic chamber through a thermal test plan, safely, and records it.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'chamber_profile_node = chamber_profile.node:main',
            'emulated_chamber = chamber_profile.emulators.chamber:main',
            'reference_logger_node = chamber_profile.reference.node:main',
            'emulated_reference_logger = chamber_profile.emulators.reference_logger:main',
        ],
    },
)
