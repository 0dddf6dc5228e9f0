# SPDX-License-Identifier: Apache-2.0
"""Build and install imu_recording."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'imu_recording'

setup(
    name=NAME,
    version='0.2.0',
    packages=find_packages(),
    package_data={NAME: ['py.typed', 'ros/fastdds.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools', 'lz4', "backports.zstd; python_version < '3.14'"],
    extras_require={'test': ['pytest'], 'logs': ['pymavlink', 'pyulog']},
    zip_safe=False,
    maintainer='imu_thermal maintainers',
    maintainer_email='maintainers@imu-thermal.example.org',
    description='The columnar IMU recording, bag input and output, message conversion and the recorder node.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'recorder_node = imu_recording.recorder.node:main',
        ],
    },
)
