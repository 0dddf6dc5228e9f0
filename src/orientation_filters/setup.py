# SPDX-License-Identifier: Apache-2.0
"""Build and install orientation_filters."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'orientation_filters'

setup(
    name=NAME,
    version='0.2.0',
    packages=find_packages(),
    package_data={NAME: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='Orientation from IMU and magnetometer: complementary filter and 12-state indirect Kalman AHRS.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'complementary_filter_node = orientation_filters.node:main_complementary',
            'ahrs_filter_node = orientation_filters.node:main_ahrs',
        ],
    },
)
