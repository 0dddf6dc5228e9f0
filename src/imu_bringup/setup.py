# SPDX-License-Identifier: Apache-2.0
"""Build and install imu_bringup."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'imu_bringup'

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
        (f'share/{NAME}/rviz', glob('rviz/*.rviz')),
        (f'share/{NAME}/layouts', glob('layouts/*')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='The chain from IMU to orientation in one process, and launch files for one board or many.',
    license='Apache-2.0',
    entry_points={'console_scripts': ['imu_chain_node = imu_bringup.chain_node:main']},
)
