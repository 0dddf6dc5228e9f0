# SPDX-License-Identifier: Apache-2.0
"""Build and install imu_driver."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'imu_driver'

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
        (f'share/{NAME}/udev', glob('udev/*.rules')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='Driver node for LSM9DS1-class IMU boards on a serial line, with emulator and simulated device.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'imu_driver_node = imu_driver.node:main',
            'emulated_device = imu_driver.emulator.emulated_device:main',
        ],
    },
)
